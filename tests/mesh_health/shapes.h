#pragma once
#include <vector>

#include "anigen/asset/mesh.h"

/// Small meshes with and without defects, for tests.
namespace anigen::test {

/// A closed cube with sides of length `size`, 8 vertices, 12 faces, counter-clockwise from outside.
inline Mesh cube(float size, const Eigen::Vector3f& low = Eigen::Vector3f::Zero()) {
  Mesh mesh;
  for (int corner = 0; corner < 8; ++corner) {
    mesh.vertices.push_back(low + size * Eigen::Vector3f(static_cast<float>(corner & 1),
                                                         static_cast<float>(corner >> 1 & 1),
                                                         static_cast<float>(corner >> 2 & 1)));
  }
  mesh.faces = {{0, 2, 3}, {0, 3, 1}, {4, 5, 7}, {4, 7, 6}, {0, 1, 5}, {0, 5, 4},
                {2, 6, 7}, {2, 7, 3}, {0, 4, 6}, {0, 6, 2}, {1, 3, 7}, {1, 7, 5}};
  return mesh;
}

/// Every corner of a face becomes a vertex of its own.
inline Mesh exploded(const Mesh& mesh) {
  Mesh result;
  for (const Triangle& face : mesh.faces) {
    const auto first = static_cast<std::int32_t>(result.vertices.size());
    for (const std::int32_t v : face) result.vertices.push_back(mesh.vertices[static_cast<std::size_t>(v)]);
    result.faces.push_back({first, first + 1, first + 2});
  }
  return result;
}

/// A flat cloth in the plane z = 0, `cells` squares along each side of length 1, faces upwards.
inline Mesh cloth(int cells) {
  Mesh mesh;
  for (int y = 0; y <= cells; ++y)
    for (int x = 0; x <= cells; ++x)
      mesh.vertices.emplace_back(static_cast<float>(x) / static_cast<float>(cells),
                                 static_cast<float>(y) / static_cast<float>(cells), 0.0f);
  for (int y = 0; y < cells; ++y) {
    for (int x = 0; x < cells; ++x) {
      const int a = y * (cells + 1) + x, b = a + 1, c = a + cells + 1, d = c + 1;
      mesh.faces.push_back({a, b, d});
      mesh.faces.push_back({a, d, c});
    }
  }
  return mesh;
}

}  // namespace anigen::test
