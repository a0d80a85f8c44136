#pragma once
#include <Eigen/Core>
#include <algorithm>

namespace anigen::geometry {

/// Parameter t in [0, 1] of the point a + t (b − a) nearest to p; 0 for a segment without length.
inline double nearest_on_segment(const Eigen::Vector3d& p, const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
  const Eigen::Vector3d along = b - a;
  const double squared = along.squaredNorm();
  if (!(squared > 0.0)) return 0.0;
  return std::clamp((p - a).dot(along) / squared, 0.0, 1.0);
}

inline double distance_to_segment(const Eigen::Vector3d& p, const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
  return (a + nearest_on_segment(p, a, b) * (b - a) - p).norm();
}

}  // namespace anigen::geometry
