#pragma once
#include <array>
#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "anigen/asset/mesh.h"
#include "anigen/asset/rigged_asset.h"
#include "anigen/io/gltf/gltf.h"

namespace anigen::io {

/// Names that an OBJ file says its materials by.
struct ObjMaterials {
  std::vector<std::string> libraries;  ///< files that `mtllib` names
  std::vector<std::string> names;      ///< that `usemtl` names, in the order of their first use
};

/// Vertices, texture coordinates, normals and polygons (triangulated as fans); vertex colours after the position
/// as several tools write them. Axes as in the file. Vertices are split where a corner uses another uv or normal.
/// @param materials if given, filled, and faces refer to its names (io/mtl.h reads the materials themselves)
/// @throws InputError naming the line
Mesh read_obj(const std::filesystem::path& path, ObjMaterials* materials = nullptr);
void write_obj(const std::filesystem::path& path, const Mesh& mesh);  ///< atomic

/// An asset for programs that read no glTF: the mesh as OBJ, and beside it `<stem>.rig.json` with `joints`, a list of
/// {name, parent, position}, parents first, -1 for the root; and `skin`, for each vertex in the OBJ's order a list of
/// [joint, weight], heaviest first, summing to 1. Both in these axes, in the asset's unit. Written atomically, the rig
/// last. @throws InputError when the mesh is unsound, or has not as many rows of weights as vertices
void write_obj_rig(const std::filesystem::path& obj, const Asset& asset, ExportAxes axes = ExportAxes::kGltf);

/// The three lists of an OBJ file and its polygons, before corners become vertices.
struct ObjFile {
  /// Indices from 0 into positions, uvs and normals; -1 where the corner names none.
  using Corner = std::array<std::int64_t, 3>;
  struct Polygon {
    std::size_t first_corner, line;
    std::int32_t material = -1;  ///< of materials.names; -1: none was named before
  };

  std::vector<Eigen::Vector3f> positions;
  std::vector<Eigen::Vector4f> colors;  ///< empty, or one per position; white where a line gives none
  std::vector<Eigen::Vector2f> uvs;     ///< origin at the top left, as in Mesh (the file's is at the bottom left)
  std::vector<Eigen::Vector3f> normals;
  std::vector<Corner> corners;
  std::vector<Polygon> polygons;  ///< each ends where the next begins
  ObjMaterials materials;
};

/// Parses the text; all indices are in range afterwards. Keywords that carry no triangles are ignored.
/// @param file only for the message @throws InputError naming the line
ObjFile parse_obj(const std::string& text, const std::string& file);

/// A decimal number that fills the whole token, whatever the locale; a leading + is allowed, so are nan and inf.
/// @return false when the token is something else or exceeds a double
bool parse_number(std::string_view token, double& value);

/// The next run of characters that are neither blanks nor line ends, removed from `text`; empty at its end.
std::string_view take_token(std::string_view& text);

/// Without blanks and line ends at both ends.
std::string_view trimmed(std::string_view text);

/// Lines of a text with their numbers, for parsers to derive from.
class TextLines {
 protected:
  TextLines(std::string_view text, const std::string& file) : rest_(text), file_(file) {}

  /// Puts the next line, without its end, into `left_`. @return false at the end of the text
  bool next_line();
  /// A finite number that fills the token.
  double number(std::string_view token) const;
  /// @throws InputError naming the line
  [[noreturn]] void fail(const std::string& problem) const;

  std::string_view rest_, left_;
  const std::string& file_;
  std::size_t line_ = 0;  ///< from 1
};

/// @throws NotSupportedError when the bytes begin as text in UTF-16 does, naming the command that converts it
void refuse_utf16(std::string_view bytes, const std::string& file);

/// Refuses what no mesh file can hold: no vertices, numbers that are not finite, arrays of another length than the
/// vertices, faces that refer to missing vertices. @throws InputError naming the file and the array
void refuse_unsound_mesh(const Mesh& mesh, const std::string& file);

/// Unit length; +Z for a vector without direction, which the contract of Mesh::normals does not allow.
Eigen::Vector3f unit_normal(const Eigen::Vector3f& normal);

/// An array index as the 32-bit number that faces hold. @throws InputError beyond 2^31 - 1
std::int32_t face_index(std::size_t index, const std::string& file);

}  // namespace anigen::io
