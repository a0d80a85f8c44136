#pragma once
#include <cstdint>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "anigen/io/arrays/ndarray.h"

namespace anigen::io {

/// Writes what Python's pickle.load, numpy.load and torch.load read: plain data, numpy arrays and torch tensors, by
/// protocol 3, or 2 as torch.save has it. Containers are opened, filled and closed.
class PickleWriter {
 public:
  explicit PickleWriter(int protocol);

  void open_list();
  void close_list() { bytes_ += 'e'; }
  void open_dict();
  void close_dict() { bytes_ += 'u'; }
  void key(std::string_view name) { text(name); }
  void text(std::string_view value);
  void integer(std::int64_t value);
  void integers(const std::vector<std::int64_t>& tuple);
  void texts(const std::vector<std::string>& list);
  /// A numpy array of numbers, row-major.
  void array(const NdArray& array);
  /// Head of a numpy array of `count` objects, which follow as items of a list; close_objects() ends it.
  void open_objects(std::size_t count);
  void close_objects();
  /// A contiguous torch tensor in the CPU storage of this name, a member data/<name> of the archive.
  /// @param array its dtype and shape
  void tensor(const NdArray& array, const std::string& storage);
  void stop() { bytes_ += '.'; }

  /// Everything written since the last call.
  std::string take() { return std::exchange(bytes_, std::string()); }

 private:
  void global(std::string_view module, std::string_view name);
  void numpy_head(const std::vector<std::int64_t>& shape);
  void dtype(std::string_view code, std::string_view order);

  std::string bytes_;
};

}  // namespace anigen::io
