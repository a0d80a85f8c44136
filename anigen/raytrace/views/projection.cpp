#include "anigen/raytrace/views/projection.h"

#include <Eigen/LU>
#include <cmath>
#include <cstddef>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"

namespace anigen::raytrace {

Eigen::Matrix4d extrinsics_of(const Eigen::Matrix4d& camera_to_world) {
  Eigen::Matrix4d opencv = camera_to_world;
  opencv.topRows<3>().col(1) *= -1.0;
  opencv.topRows<3>().col(2) *= -1.0;
  Eigen::Matrix4d inverse;
  bool invertible = false;
  opencv.computeInverseWithCheck(inverse, invertible);
  if (!invertible || !inverse.allFinite()) {
    throw InputError("", "transform_matrix", "the camera's matrix has no inverse");
  }
  return inverse;
}

Eigen::Matrix3d intrinsics_of(double fov) {
  if (!(fov > 0.0 && fov < kPi)) {
    throw InputError("", "camera_angle_x", "the field of view must be between 0 and pi");
  }
  const double focal = 0.5 / std::tan(0.5 * fov);
  Eigen::Matrix3d matrix = Eigen::Matrix3d::Identity();
  matrix(0, 0) = matrix(1, 1) = focal;
  matrix(0, 2) = matrix(1, 2) = 0.5;
  return matrix;
}

Eigen::Vector3d project(const Eigen::Vector3d& point, const Eigen::Matrix4d& extrinsics,
                        const Eigen::Matrix3d& intrinsics) {
  const Eigen::Vector3d in_camera = extrinsics.topLeftCorner<3, 3>() * point + extrinsics.topRightCorner<3, 1>();
  const Eigen::Vector3d on_plane = intrinsics * in_camera;
  return {on_plane.x() / on_plane.z(), on_plane.y() / on_plane.z(), in_camera.z()};
}

Eigen::Vector3d unproject(const Eigen::Vector3d& uv_depth, const Eigen::Matrix4d& extrinsics,
                          const Eigen::Matrix3d& intrinsics) {
  const Eigen::Vector3d on_plane(uv_depth.x() * uv_depth.z(), uv_depth.y() * uv_depth.z(), uv_depth.z());
  const Eigen::Vector3d in_camera = intrinsics.inverse() * on_plane;
  return extrinsics.topLeftCorner<3, 3>().inverse() * (in_camera - extrinsics.topRightCorner<3, 1>());
}

Eigen::Matrix4d clip_projection(const Eigen::Matrix3d& intrinsics, double near, double far) {
  if (!(near > 0.0 && far > near && std::isfinite(far))) {
    throw InputError("", "near, far", "must be finite with 0 < near < far");
  }
  Eigen::Matrix4d matrix = Eigen::Matrix4d::Zero();
  matrix(0, 0) = 2.0 * intrinsics(0, 0);
  matrix(0, 2) = 2.0 * intrinsics(0, 2) - 1.0;
  matrix(1, 1) = 2.0 * intrinsics(1, 1);
  matrix(1, 2) = 1.0 - 2.0 * intrinsics(1, 2);
  matrix(2, 2) = far / (far - near);
  matrix(2, 3) = near * far / (near - far);
  matrix(3, 2) = 1.0;
  return matrix;
}

std::vector<Eigen::Vector2d> image_uv(int width, int height) {
  if (width < 1 || height < 1) throw InputError("", "image_uv", "a picture needs pixels");
  std::vector<Eigen::Vector2d> centres;
  centres.reserve(static_cast<std::size_t>(width) * static_cast<std::size_t>(height));
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) centres.emplace_back((x + 0.5) / width, (y + 0.5) / height);
  }
  return centres;
}

}  // namespace anigen::raytrace
