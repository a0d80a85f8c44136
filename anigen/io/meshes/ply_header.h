#pragma once
#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

namespace anigen::io {

enum class PlyFormat { kAscii, kLittleEndian, kBigEndian };
enum class PlyType { kInt8, kUint8, kInt16, kUint16, kInt32, kUint32, kFloat32, kFloat64 };

std::size_t size_of(PlyType type);  ///< bytes in a binary file
bool is_integer(PlyType type);
double largest_of(PlyType type);  ///< largest value of an integer type

struct PlyProperty {
  std::string name;
  bool is_list = false;
  PlyType count_type = PlyType::kUint8;  ///< of a list's length
  PlyType type = PlyType::kFloat32;      ///< of the value, or of a list's items
};

struct PlyElement {
  std::string name;
  std::uint64_t count = 0;
  std::vector<PlyProperty> properties;

  /// Fewest bytes that one row can take in the format.
  std::size_t least_bytes(PlyFormat format) const;
};

struct PlyHeader {
  PlyFormat format = PlyFormat::kAscii;
  std::vector<PlyElement> elements;
  std::size_t bytes = 0, lines = 0;  ///< where the data begins
};

/// Parses everything up to end_header. Headers beyond 1 MiB and elements that could not fit into the rest of the file
/// are refused here, so readers may trust the counts. @throws InputError naming the line
PlyHeader parse_ply_header(const std::string& bytes, const std::string& file);

}  // namespace anigen::io
