#include "anigen/raytrace/views/view_plan.h"

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"

namespace anigen::raytrace {
namespace {

/// Radius of the sphere around the cube [-0.5, 0.5]³.
const double kCubeSphere = std::sqrt(3.0) / 2.0;
constexpr double kWidestFov = 70.0 * kPi / 180.0, kNarrowestFov = 10.0 * kPi / 180.0;

/// The binary digits of i mirrored at the point (Van der Corput, base 2).
double radical_inverse(std::uint64_t i) {
  double result = 0.0;
  for (double digit = 0.5; i > 0; i >>= 1, digit *= 0.5) {
    if (i & 1) result += digit;
  }
  return result;
}

void require_views(std::size_t n) {
  if (n == 0) throw InputError("", "views", "there must be at least one view");
}

}  // namespace

ViewCamera hammersley_view(std::size_t i, std::size_t n, double offset0, double offset1, bool upper) {
  double u = (static_cast<double>(i) + offset0) / static_cast<double>(n);
  const double v = radical_inverse(i) + offset1;
  if (upper) u = u < 0.25 ? 2.0 * u : 2.0 * u / 3.0 + 1.0 / 3.0;
  ViewCamera view;
  view.pitch = std::acos(std::clamp(1.0 - 2.0 * u, -1.0, 1.0)) - 0.5 * kPi;
  view.yaw = 2.0 * kPi * v;
  return view;
}

std::vector<ViewCamera> feature_views(std::size_t n, double offset0, double offset1) {
  require_views(n);
  std::vector<ViewCamera> views;
  for (std::size_t i = 0; i < n; ++i) {
    views.push_back(hammersley_view(i, n, offset0, offset1, true));
    views.back().radius = kFeatureRadius;
    views.back().fov = kFeatureFov;
  }
  return views;
}

std::vector<ViewCamera> condition_views(std::size_t n, Rng& rng) {
  const double offset0 = rng.uniform(), offset1 = rng.uniform();
  std::vector<ViewCamera> views = feature_views(n, offset0, offset1);
  const double nearest = kCubeSphere / std::sin(0.5 * kWidestFov),
               farthest = kCubeSphere / std::sin(0.5 * kNarrowestFov);
  for (ViewCamera& view : views) {
    view.radius = 1.0 / std::sqrt(rng.uniform(1.0 / (farthest * farthest), 1.0 / (nearest * nearest)));
    view.fov = 2.0 * std::asin(kCubeSphere / view.radius);
  }
  return views;
}

std::vector<ViewCamera> front_views(std::size_t n, Rng& rng) {
  require_views(n);
  constexpr double kFront = -0.5 * kPi, kSide = kPi / 3.0, kLowest = -5.0 * kPi / 180.0, kHighest = kPi / 6.0;
  std::vector<ViewCamera> views(n);
  for (std::size_t i = 0; i < n; ++i) {
    const double place = (static_cast<double>(i) + rng.uniform()) / static_cast<double>(n);
    views[i].yaw = kFront + kSide * (2.0 * place - 1.0);
    views[i].pitch = rng.uniform(kLowest, kHighest);
    views[i].fov = kFeatureFov;
    views[i].radius = kCubeSphere / std::sin(0.5 * kFeatureFov);
  }
  return views;
}

Eigen::Matrix4d camera_to_world(const ViewCamera& view) {
  const bool finite = std::isfinite(view.yaw) && std::isfinite(view.pitch) && std::isfinite(view.radius);
  if (!finite || !(view.radius > 0.0)) throw InputError("", "view", "its angles or its radius are out of range");
  if (!(view.fov > 0.0 && view.fov < kPi)) throw InputError("", "view", "its field of view is not between 0 and pi");
  const double cos_yaw = std::cos(view.yaw), sin_yaw = std::sin(view.yaw);
  const double cos_pitch = std::cos(view.pitch), sin_pitch = std::sin(view.pitch);
  const Eigen::Vector3d back(cos_yaw * cos_pitch, sin_yaw * cos_pitch, sin_pitch);
  Eigen::Matrix4d matrix = Eigen::Matrix4d::Identity();
  matrix.col(0).head<3>() = Eigen::Vector3d(-sin_yaw, cos_yaw, 0.0);
  matrix.col(1).head<3>() = Eigen::Vector3d(-cos_yaw * sin_pitch, -sin_yaw * sin_pitch, cos_pitch);
  matrix.col(2).head<3>() = back;
  matrix.col(3).head<3>() = view.radius * back;
  return matrix;
}

}  // namespace anigen::raytrace
