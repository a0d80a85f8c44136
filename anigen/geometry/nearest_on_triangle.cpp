#include <algorithm>
#include <cmath>
#include <limits>

#include "anigen/geometry/nearest_surface.h"
#include "anigen/geometry/segment.h"

namespace anigen::geometry {

NearestPoint nearest_on_triangle(const Eigen::Vector3d& p, const Eigen::Vector3d& a, const Eigen::Vector3d& b,
                                 const Eigen::Vector3d& c) {
  NearestPoint best;
  const Eigen::Vector3d ab = b - a, ac = c - a, ap = p - a;
  const Eigen::Vector3d normal = ab.cross(ac);
  const double squared = normal.squaredNorm();
  // Relative to the edges: a sliver's projection is rounding noise, while its edges are still exact.
  if (squared > 1e-24 * ab.squaredNorm() * ac.squaredNorm()) {
    const double v = ap.cross(ac).dot(normal), w = ab.cross(ap).dot(normal);
    if (v >= 0.0 && w >= 0.0 && v + w <= squared) {
      best.at.barycentric = {1.0 - v / squared - w / squared, v / squared, w / squared};
      best.position = a + best.at.barycentric[1] * ab + best.at.barycentric[2] * ac;
      best.distance = (best.position - p).norm();
      // Rounding of the difference only; the weights are promised not to be negative.
      best.at.barycentric[0] = std::max(best.at.barycentric[0], 0.0);
      return best;
    }
  }
  // Not above the inside: the nearest point is on the boundary.
  const Eigen::Vector3d* corners[3] = {&a, &b, &c};
  double nearest = std::numeric_limits<double>::infinity(), along = 0.0;
  int edge = 0;
  for (int k = 0; k < 3; ++k) {
    const Eigen::Vector3d &start = *corners[k], &end = *corners[(k + 1) % 3];
    const double t = nearest_on_segment(p, start, end);
    const Eigen::Vector3d position = start + t * (end - start);
    const double distance = (position - p).squaredNorm();
    if (distance < nearest) {
      nearest = distance;
      best.position = position;
      along = t;
      edge = k;
    }
  }
  best.distance = std::sqrt(nearest);
  best.at.barycentric[edge] = 1.0 - along;
  best.at.barycentric[(edge + 1) % 3] = along;
  return best;
}

}  // namespace anigen::geometry
