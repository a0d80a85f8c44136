#pragma once
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "anigen/asset/mesh.h"

namespace anigen::io {

/// ASCII and binary (either endianness); vertices x, y, z, optional normals, optional red/green/blue/alpha,
/// optional texture coordinates (s/t, u/v or texture_u/texture_v), optional faces (polygons are triangulated as fans);
/// a file without faces is a point cloud. Axes as in the file.
/// @throws InputError naming line or byte, NotSupportedError for triangle strips
Mesh read_ply(const std::filesystem::path& path);
/// Binary little-endian, atomic; what the mesh has of normals, texture coordinates and faces. Colours are written as
/// 8-bit when the mesh has them.
void write_ply(const std::filesystem::path& path, const Mesh& mesh);

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
