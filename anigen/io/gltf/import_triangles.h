#pragma once
#include <cstdint>
#include <vector>

#include "anigen/asset/mesh.h"

namespace anigen::io::gltf_import {

struct TriangleList {
  std::vector<Triangle> faces;
  std::size_t degenerate = 0;  ///< triangles that named a vertex twice and were left out
  std::size_t left_over = 0;   ///< indices at the end that made no triangle
};

/// Triangles of a primitive (glTF 2.0, section 3.7.2.1).
/// @param mode 4 triangles, 5 strip, 6 fan @param indices vertex numbers, below 2^31
TriangleList triangulate(int mode, const std::vector<std::uint32_t>& indices);

}  // namespace anigen::io::gltf_import
