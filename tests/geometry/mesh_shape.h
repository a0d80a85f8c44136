#pragma once
#include <Eigen/Geometry>
#include <cstddef>
#include <cstdint>
#include <map>
#include <set>
#include <utility>
#include <vector>

#include "anigen/asset/mesh.h"

/// Properties of whole surfaces, for tests.
namespace anigen::test {

/// Edges by how many faces meet there.
struct EdgeCensus {
  std::size_t all = 0;
  std::size_t border = 0;       ///< one face
  std::size_t crowded = 0;      ///< more than two
  std::size_t disagreeing = 0;  ///< two that run along it in the same direction

  bool is_closed() const { return border == 0 && crowded == 0 && disagreeing == 0; }
};

inline EdgeCensus edge_census(const std::vector<Triangle>& faces) {
  std::map<std::pair<std::int32_t, std::int32_t>, std::pair<int, int>> sides;  // along and against
  for (const Triangle& face : faces) {
    for (std::size_t k = 0; k < 3; ++k) {
      const std::int32_t a = face[k], b = face[(k + 1) % 3];
      auto& [along, against] = sides[std::minmax(a, b)];
      ++(a < b ? along : against);
    }
  }
  EdgeCensus census;
  census.all = sides.size();
  for (const auto& [edge, counts] : sides) {
    const int faces_there = counts.first + counts.second;
    census.border += faces_there == 1;
    census.crowded += faces_there > 2;
    census.disagreeing += faces_there == 2 && counts.first != 1;
  }
  return census;
}

/// Vertices in use − edges + faces: 2 for a sphere, 0 for a torus, added up over the parts.
inline std::ptrdiff_t euler_characteristic(const Mesh& mesh) {
  std::set<std::int32_t> used;
  for (const Triangle& face : mesh.faces) used.insert(face.begin(), face.end());
  return static_cast<std::ptrdiff_t>(used.size()) - static_cast<std::ptrdiff_t>(edge_census(mesh.faces).all) +
         static_cast<std::ptrdiff_t>(mesh.faces.size());
}

/// Volume enclosed by a closed surface; positive when its faces are counter-clockwise from outside.
inline double enclosed_volume(const Mesh& mesh) {
  double volume = 0.0;
  for (const Triangle& face : mesh.faces) {
    const auto corner = [&](std::size_t k) {
      return Eigen::Vector3d(mesh.vertices[static_cast<std::size_t>(face[k])].cast<double>());
    };
    volume += corner(0).dot(corner(1).cross(corner(2))) / 6.0;
  }
  return volume;
}

/// Both meshes in one, as separate parts.
inline Mesh together(Mesh first, const Mesh& second) {
  const auto offset = static_cast<std::int32_t>(first.vertices.size());
  first.vertices.insert(first.vertices.end(), second.vertices.begin(), second.vertices.end());
  for (const auto& [a, b, c] : second.faces) first.faces.push_back({a + offset, b + offset, c + offset});
  return first;
}

}  // namespace anigen::test
