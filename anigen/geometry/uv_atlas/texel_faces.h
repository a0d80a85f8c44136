#pragma once
#include <cstdint>
#include <vector>

#include "anigen/geometry/uv_atlas/uv_atlas.h"

namespace anigen::geometry {

/// Which face of the atlas a texel shows, [size · size], rows from top to bottom: the face that its centre lies in; for
/// a centre outside all of them but less than a texel's diagonal away from one, which a bilinear lookup on that face
/// can touch, the nearest; else -1. Equally near faces, or faces that overlap, give the lowest number.
std::vector<std::int32_t> texel_faces(const UvAtlas& atlas);

/// Corner k of an atlas face in texels from the top left corner of the texture; z is 0.
inline Eigen::Vector3d texel_corner(const UvAtlas& atlas, const Triangle& face, std::size_t k) {
  const Eigen::Vector2f& uv = atlas.uvs[static_cast<std::size_t>(face[k])];
  return {static_cast<double>(uv.x()) * atlas.size, static_cast<double>(uv.y()) * atlas.size, 0.0};
}

}  // namespace anigen::geometry
