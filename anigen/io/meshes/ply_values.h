#pragma once
#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>

#include "anigen/io/meshes/ply_header.h"

namespace anigen::io {

/// Reads the values behind a PLY header one after the other, whichever way they are stored. Every double holds every
/// value of every PLY type.
class PlyValues {
 public:
  PlyValues(const std::string& bytes, const PlyHeader& header, const std::string& file);

  /// @throws InputError at the end of the data, on text that is no number, or that does not fit the type
  double next(PlyType type);
  /// The length of a list whose items follow. @throws InputError when it is negative or exceeds the file
  std::size_t next_length(const PlyProperty& property);

  [[noreturn]] void fail(const std::string& problem) const;

 private:
  double next_text(PlyType type);
  double next_binary(PlyType type);

  const std::string& bytes_;
  const std::string& file_;
  PlyFormat format_;
  std::size_t at_, line_;
};

}  // namespace anigen::io
