#include "anigen/rig/binding/cotangent_laplacian.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>

#include "anigen/core/numeric.h"

namespace anigen::rig {
namespace {

constexpr double kLargestCotangent = 1e3;

/// Of the angles at the three corners.
std::array<double, 3> cotangents(const std::array<Eigen::Vector3d, 3>& corners, double twice_area) {
  std::array<double, 3> result{};
  bool is_sliver = !(twice_area > 0.0);
  for (std::size_t k = 0; k < 3; ++k) {
    const Eigen::Vector3d &p = corners[k], &q = corners[(k + 1) % 3], &r = corners[(k + 2) % 3];
    const double dot = (q - p).dot(r - p);
    result[k] = dot / twice_area;
    if (!(twice_area > 0.0)) result[k] = dot > 0.0 ? kLargestCotangent : 0.0;
    is_sliver = is_sliver || !(std::abs(result[k]) <= kLargestCotangent);
  }
  if (is_sliver) {
    for (double& cotangent : result) cotangent = std::clamp(cotangent, 0.0, kLargestCotangent);
  }
  return result;
}

}  // namespace

CotangentLaplacian cotangent_laplacian(const WeldedSurface& surface) {
  CotangentLaplacian laplacian;
  laplacian.areas.assign(surface.places.size(), 0.0);
  laplacian.edges.reserve(3 * surface.faces.size());
  for (const Triangle& face : surface.faces) {
    const std::array<Eigen::Vector3d, 3> corners = {surface.places[at(face[0])], surface.places[at(face[1])],
                                                    surface.places[at(face[2])]};
    const double twice_area = (corners[1] - corners[0]).cross(corners[2] - corners[0]).norm();
    const std::array<double, 3> opposite = cotangents(corners, twice_area);
    for (std::size_t k = 0; k < 3; ++k) {
      const auto [low, high] = std::minmax(face[(k + 1) % 3], face[(k + 2) % 3]);
      laplacian.edges.push_back({low, high, 0.5 * opposite[k]});
      laplacian.areas[at(face[k])] += twice_area / 6.0;
    }
  }
  // Stable, so that sums are taken in the order of faces.
  std::vector<CotangentLaplacian::Edge>& edges = laplacian.edges;
  std::stable_sort(edges.begin(), edges.end(),
                   [](const auto& e, const auto& f) { return e.a != f.a ? e.a < f.a : e.b < f.b; });
  std::size_t kept = 0;
  for (std::size_t e = 0; e < edges.size(); ++e) {
    if (kept > 0 && edges[kept - 1].a == edges[e].a && edges[kept - 1].b == edges[e].b) {
      edges[kept - 1].conductance += edges[e].conductance;
    } else {
      edges[kept++] = edges[e];
    }
  }
  edges.resize(kept);
  return laplacian;
}

}  // namespace anigen::rig
