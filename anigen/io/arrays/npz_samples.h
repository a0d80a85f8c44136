#pragma once
#include <cstddef>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "anigen/io/arrays/npz.h"
#include "anigen/io/arrays/pickle_outline.h"
#include "anigen/io/arrays/zip_seek.h"

namespace anigen::io {

/// The dictionaries of an object array in an NPZ file, each read from the file when it is asked for. Opening reads the
/// array once and keeps about 100 bytes a dictionary, its short texts, and at most 10 MiB of decompressor states.
class NpzSamples {
 public:
  /// The first member that is such an array; `allow_pickle` is none.
  /// @param name_key of the text that names a dictionary
  /// @return null when no member is, or its dictionaries share objects: then only read_npz_objects() can say more
  /// @throws InputError for damaged files
  static std::unique_ptr<const NpzSamples> open(const std::filesystem::path& file, const std::string& name_key);

  ~NpzSamples();

  std::size_t size() const { return outline_->dicts().size(); }
  /// Of a dictionary; empty when it has none.
  const std::string& name(std::size_t index) const { return outline_->dicts().at(index).name; }
  /// Several threads may read at once. @throws InputError and NotSupportedError naming file, member and byte
  NpzValue read(std::size_t index) const;

 private:
  struct Bytes;
  NpzSamples(std::unique_ptr<const Bytes> bytes, std::unique_ptr<const pickle::Outline> outline);

  std::unique_ptr<const Bytes> bytes_;
  std::unique_ptr<const pickle::Outline> outline_;
};

}  // namespace anigen::io
