#include "anigen/features/surface_rays.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>

namespace anigen::features {
namespace {

constexpr std::size_t kRays = 32;

// Van der Corput sequence in base 2: the bits of i behind the point, mirrored.
double radical_inverse(std::size_t i) {
  double value = 0.0;
  for (double digit = 0.5; i > 0; i >>= 1, digit /= 2.0) value += static_cast<double>(i & 1) * digit;
  return value;
}

// Directions about +z with a density proportional to the cosine, from Hammersley's points (Malley's method).
const std::array<Eigen::Vector3d, kRays>& hemisphere() {
  static const std::array<Eigen::Vector3d, kRays> directions = [] {
    constexpr double kTurn = 6.283185307179586;
    std::array<Eigen::Vector3d, kRays> list;
    for (std::size_t i = 0; i < kRays; ++i) {
      const double squared = (static_cast<double>(i) + 0.5) / kRays, angle = kTurn * radical_inverse(i);
      const double radius = std::sqrt(squared);
      list[i] = {radius * std::cos(angle), radius * std::sin(angle), std::sqrt(1.0 - squared)};
    }
    return list;
  }();
  return directions;
}

// A rotation that takes +z to the normal (Duff et al. 2017, "Building an orthonormal basis, revisited").
Eigen::Matrix3d frame_about(const Eigen::Vector3d& n) {
  const double sign = std::copysign(1.0, n.z()), a = -1.0 / (sign + n.z()), b = n.x() * n.y() * a;
  Eigen::Matrix3d frame;
  frame.col(0) = Eigen::Vector3d(1.0 + sign * n.x() * n.x() * a, sign * b, -sign * n.x());
  frame.col(1) = Eigen::Vector3d(b, sign + n.y() * n.y() * a, -n.y());
  frame.col(2) = n;
  return frame;
}

double capped(const std::optional<double>& distance) { return std::min(distance.value_or(1.0), 1.0); }

}  // namespace

SurfaceSight look_around(const geometry::RayCaster& caster, const Eigen::Vector3d& foot, const Eigen::Vector3d& normal,
                         double lift, double near_radius, double far_radius) {
  const Eigen::Matrix3d frame = frame_about(normal);
  const Eigen::Vector3d above = foot + lift * normal;
  int near_free = 0, far_free = 0;
  for (const Eigen::Vector3d& direction : hemisphere()) {
    const double way = caster.first_hit(above, frame * direction).value_or(std::numeric_limits<double>::infinity());
    near_free += way > near_radius ? 1 : 0;
    far_free += way > far_radius ? 1 : 0;
  }
  SurfaceSight sight;
  sight.near_openness = static_cast<double>(near_free) / kRays;
  sight.far_openness = static_cast<double>(far_free) / kRays;
  sight.thickness = capped(caster.first_hit(foot, -normal, lift));
  sight.gap = capped(caster.first_hit(foot, normal, lift));
  return sight;
}

}  // namespace anigen::features
