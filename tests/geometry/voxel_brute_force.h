#pragma once
#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <vector>

#include "anigen/asset/mesh.h"
#include "anigen/geometry/voxel_grid.h"

namespace anigen::test {

/// Corners in voxels from the grid's corner.
using GridTriangle = std::array<Eigen::Vector3d, 3>;

inline GridTriangle grid_triangle(const std::vector<Eigen::Vector3f>& vertices, const Triangle& face, int resolution) {
  GridTriangle triangle;
  for (std::size_t k = 0; k < 3; ++k) {
    const Eigen::Vector3d vertex = vertices[static_cast<std::size_t>(face[k])].cast<double>();
    const double edge = 0.5 - 1e-6;
    triangle[k] = (vertex.cwiseMax(-edge).cwiseMin(edge).array() + 0.5) * resolution;
  }
  return triangle;
}

/// The separating-axis test of a triangle and a closed unit box, written from the theorem: the largest gap between
/// their projections onto the 13 directions, in voxels; > 0 when they are apart, < 0 when they overlap, 0 when they
/// touch. Directions without length are left out. Returns as soon as a gap exceeds `enough`.
inline double separation(const GridTriangle& triangle, const geometry::Voxel& voxel, double enough) {
  const Eigen::Vector3d low(voxel[0], voxel[1], voxel[2]), middle = low.array() + 0.5;
  GridTriangle t;
  for (std::size_t k = 0; k < 3; ++k) t[k] = triangle[k] - middle;
  double gap = -std::numeric_limits<double>::infinity();
  const auto apart = [&](const Eigen::Vector3d& direction) {
    const double length = direction.norm();
    if (!(length > 1e-12)) return false;
    const double a = direction.dot(t[0]), b = direction.dot(t[1]), c = direction.dot(t[2]);
    const double reach = 0.5 * direction.cwiseAbs().sum();
    gap = std::max(gap, (std::max(std::min({a, b, c}) - reach, -reach - std::max({a, b, c}))) / length);
    return gap > enough;
  };
  for (int axis = 0; axis < 3; ++axis) {
    if (apart(Eigen::Vector3d::Unit(axis))) return gap;
  }
  const GridTriangle edges = {t[1] - t[0], t[2] - t[1], t[0] - t[2]};
  if (apart(edges[0].cross(edges[1]))) return gap;
  for (const Eigen::Vector3d& edge : edges) {
    for (int axis = 0; axis < 3; ++axis) {
      if (apart(edge.cross(Eigen::Vector3d::Unit(axis)))) return gap;
    }
  }
  return gap;
}

/// Voxels whose box comes within one voxel of the triangle's box: all others are apart along an axis.
template <typename Visit>
void for_candidates(const GridTriangle& t, int resolution, const Visit& visit) {
  geometry::Voxel low{}, high{};
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const auto i = static_cast<Eigen::Index>(axis);
    const auto [least, most] = std::minmax({t[0][i], t[1][i], t[2][i]});
    low[axis] = std::max(0, static_cast<int>(std::floor(least)) - 1);
    high[axis] = std::min(resolution - 1, static_cast<int>(std::floor(most)) + 1);
  }
  for (int x = low[0]; x <= high[0]; ++x) {
    for (int y = low[1]; y <= high[1]; ++y) {
      for (int z = low[2]; z <= high[2]; ++z) visit(geometry::Voxel{x, y, z});
    }
  }
}

}  // namespace anigen::test
