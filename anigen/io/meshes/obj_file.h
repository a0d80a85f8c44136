#pragma once
#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "anigen/asset/mesh.h"

namespace anigen::io {

/// The three lists of an OBJ file and its polygons, before corners become vertices.
struct ObjFile {
  /// Indices from 0 into positions, uvs and normals; -1 where the corner names none.
  using Corner = std::array<std::int64_t, 3>;
  struct Polygon {
    std::size_t first_corner, line;
  };

  std::vector<Eigen::Vector3f> positions;
  std::vector<Eigen::Vector4f> colors;  ///< empty, or one per position; white where a line gives none
  std::vector<Eigen::Vector2f> uvs;     ///< origin at the top left, as in Mesh (the file's is at the bottom left)
  std::vector<Eigen::Vector3f> normals;
  std::vector<Corner> corners;
  std::vector<Polygon> polygons;  ///< each ends where the next begins
};

/// Parses the text; all indices are in range afterwards. Keywords that carry no triangles are ignored.
/// @param file only for the message @throws InputError naming the line
ObjFile parse_obj(const std::string& text, const std::string& file);

}  // namespace anigen::io
