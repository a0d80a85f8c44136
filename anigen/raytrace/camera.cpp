#include "anigen/raytrace/camera.h"

#include <algorithm>
#include <cmath>
#include <string>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"

namespace anigen::raytrace {
namespace {

constexpr double kRadians = kPi / 180.0;

void check_range(double value, double low, double high, const char* option) {
  if (value >= low && value <= high) return;
  throw InputError("", option, "must be between " + std::to_string(low) + " and " + std::to_string(high));
}

Box target_box(const Orbit& orbit, const std::vector<Eigen::Vector3f>& points) {
  Box box = orbit.fit ? *orbit.fit : bounding_box(points);
  if (box.empty()) {
    box.low.setConstant(-0.5);
    box.high.setConstant(0.5);
  }
  if (!box.low.allFinite() || !box.high.allFinite()) throw InputError("", "fit", "the box to look at is not finite");
  return box;
}

Camera oriented(const Orbit& orbit, int width, int height) {
  check_range(orbit.yaw_degrees, -1e6, 1e6, "yaw_degrees");
  check_range(orbit.pitch_degrees, -90.0, 90.0, "pitch_degrees");
  check_range(orbit.fov_degrees, 1.0, 150.0, "fov_degrees");
  check_range(orbit.margin, 0.01, 100.0, "margin");
  check_range(width, 1, 16384, "width");
  check_range(height, 1, 16384, "height");
  const double yaw = orbit.yaw_degrees * kRadians, pitch = orbit.pitch_degrees * kRadians;
  Camera camera;
  camera.right = {std::cos(yaw), std::sin(yaw), 0.0};
  camera.forward = {-std::sin(yaw) * std::cos(pitch), std::cos(yaw) * std::cos(pitch), -std::sin(pitch)};
  camera.up = camera.right.cross(camera.forward);
  camera.tangent = std::tan(0.5 * orbit.fov_degrees * kRadians);
  camera.width = width;
  camera.height = height;
  return camera;
}

/// Where the eye must be for everything to lie inside the frustum, relative to the target and along the camera's axes.
struct Placement {
  double right = 0.0, up = 0.0, back = 0.0;
};

/// Every point gives one bound per side plane of the frustum; the tightest eye position follows in closed form.
/// @param centred keep the eye on the axis through the target, else shift it so that opposite sides are as near
Placement fit(const Camera& camera, const Orbit& orbit, const Box& box, const std::vector<Eigen::Vector3f>& points,
              bool centred) {
  const double tangent_y = camera.tangent / orbit.margin;
  const double tangent_x = tangent_y * camera.width / camera.height;
  double right = -1e300, left = -1e300, above = -1e300, below = -1e300;
  const auto include = [&](const Eigen::Vector3d& point) {
    const Eigen::Vector3d offset = point - box.center();
    const double x = offset.dot(camera.right), y = offset.dot(camera.up), z = -offset.dot(camera.forward);
    right = std::max(right, x + z * tangent_x);
    left = std::max(left, -x + z * tangent_x);
    above = std::max(above, y + z * tangent_y);
    below = std::max(below, -y + z * tangent_y);
  };
  if (orbit.fit || points.empty()) {
    for (int corner = 0; corner < 8; ++corner) {
      include({corner & 1 ? box.high.x() : box.low.x(), corner & 2 ? box.high.y() : box.low.y(),
               corner & 4 ? box.high.z() : box.low.z()});
    }
  } else {
    for (const Eigen::Vector3f& point : points) include(point.cast<double>());
  }
  Placement place;
  if (centred) {
    place.back = std::max(std::max(right, left) / tangent_x, std::max(above, below) / tangent_y);
  } else {
    place.right = 0.5 * (right - left);
    place.up = 0.5 * (above - below);
    place.back = std::max(0.5 * (right + left) / tangent_x, 0.5 * (above + below) / tangent_y);
  }
  if (!(place.back > 0.0)) place.back = 1.0;  // a single point
  return place;
}

}  // namespace

Eigen::Vector3d Camera::ray(double x, double y) const {
  const double scale = 2.0 * tangent / height;
  return forward + (x - 0.5 * width) * scale * right - (y - 0.5 * height) * scale * up;
}

Eigen::Vector3d Camera::direction(double x, double y) const { return ray(x, y).normalized(); }

Eigen::Vector3d Camera::project(const Eigen::Vector3d& point) const {
  const Eigen::Vector3d offset = point - eye;
  const double depth = offset.dot(forward);
  const double scale = 0.5 * height / (tangent * depth);
  return {0.5 * width + offset.dot(right) * scale, 0.5 * height - offset.dot(up) * scale, depth};
}

Camera orbit_camera(const Orbit& orbit, const std::vector<Eigen::Vector3f>& points, int width, int height) {
  Camera camera = oriented(orbit, width, height);
  const Box box = target_box(orbit, points);
  Placement place;
  if (orbit.distance) {
    check_range(*orbit.distance, 1e-12, 1e16, "distance");
    place.back = *orbit.distance;
  } else {
    place = fit(camera, orbit, box, points, orbit.fit.has_value());
  }
  camera.eye = box.center() + place.right * camera.right + place.up * camera.up - place.back * camera.forward;
  return camera;
}

double centred_distance(const Orbit& orbit, const std::vector<Eigen::Vector3f>& points, int width, int height) {
  return fit(oriented(orbit, width, height), orbit, target_box(orbit, points), points, true).back;
}

}  // namespace anigen::raytrace
