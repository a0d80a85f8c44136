#pragma once
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <map>
#include <string>
#include <vector>

#include "anigen/io/arrays/ndarray.h"

namespace anigen::io {

/// A safetensors file with its header read and checked; tensors are read one by one. Not for several threads at once.
class SafetensorsReader {
 public:
  /// Checks header length, ranges, overlaps, gaps and dtypes. @throws InputError with the byte offset
  explicit SafetensorsReader(const std::filesystem::path& path);

  /// Names, in order of the offsets in the file.
  std::vector<std::string> names() const;
  const std::map<std::string, std::string>& metadata() const { return metadata_; }  ///< the "__metadata__" entry
  Dtype dtype(std::size_t index) const { return entries_[index].array.dtype; }
  /// @param index into names() @throws InputError when the file ends early
  NdArray read(std::size_t index);

  struct Entry {
    std::string name;
    NdArray array;                     ///< without bytes
    std::uint64_t begin = 0, end = 0;  ///< in the data section
  };

 private:
  std::filesystem::path path_;
  std::ifstream in_;
  std::map<std::string, std::string> metadata_;
  std::vector<Entry> entries_;
  std::uint64_t data_start_ = 0;
};

struct SafetensorsFile {
  NamedArrays tensors;                          ///< in order of their offsets in the file
  std::map<std::string, std::string> metadata;  ///< the "__metadata__" entry
};

/// All of a file. @throws InputError as SafetensorsReader
SafetensorsFile read_safetensors(const std::filesystem::path& path);

/// The "__metadata__" entry alone: none of the data is read. @throws InputError as SafetensorsReader
std::map<std::string, std::string> read_safetensors_metadata(const std::filesystem::path& path);

/// Atomic; equal input gives equal bytes. The data section starts at a multiple of 8 bytes, tensors follow each other
/// in the order given without gaps (which the format forbids). @throws WriteError when the disk refuses; Error when a
/// name is taken twice or reserved
void write_safetensors(const std::filesystem::path& path, const NamedArrays& tensors,
                       const std::map<std::string, std::string>& metadata = {});

/// Choice of the file of weights in a model folder (docs/reference/flows.md, 6.1 and 6.2). All functions take the model
/// folder, whose files lie in its `ckpts/`, or that folder itself. Besides the published `.pt` files they accept
/// `.safetensors` with the same stems, which our trainer writes. Where both exist for one stem the `.pt` wins, so that
/// a published folder reads as published whatever was converted beside it. Optimiser state (`misc…`, `state…`) is never
/// chosen.

/// A flow model's file. Without prefer_ema: files whose name contains no "ema"; if there is none, the moving averages,
/// with a warning. With prefer_ema: the other way round. Among them the highest step wins; names without a step count
/// as -1; equal steps go by name.
/// @throws InputError when the folder is missing or holds no weights
std::filesystem::path choose_flow_checkpoint(const std::filesystem::path& folder, bool prefer_ema);

/// `<model>_<name>`, else `<name>`: model "encoder" and name "final" find encoder_final.pt.
/// @throws InputError that lists what was tried and what is there
std::filesystem::path choose_checkpoint(const std::filesystem::path& folder, const std::string& model,
                                        const std::string& name);

/// Names of the .pt and .safetensors files that lie directly in a folder, by stem; of two with one stem only the .pt.
/// Temporary files, which killed writers leave behind, do not count. @throws InputError when it cannot be listed
std::vector<std::string> checkpoint_names(const std::filesystem::path& folder);

/// The integer after the last "step" of a file name ("denoiser_step0000200.pt": 200); -1 when there is none.
std::int64_t step_of(const std::string& file_name);

}  // namespace anigen::io
