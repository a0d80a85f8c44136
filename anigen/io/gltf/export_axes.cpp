#include "anigen/io/gltf/export_axes.h"

namespace anigen::io {

Eigen::Matrix3d axis_rotation(ExportAxes axes) {
  Eigen::Matrix3d rotation;
  if (axes == ExportAxes::kPublished) {
    rotation << -1, 0, 0, 0, 0, 1, 0, 1, 0;
  } else {
    rotation << 1, 0, 0, 0, 0, 1, 0, -1, 0;
  }
  return rotation;
}

Eigen::Quaterniond axis_quaternion(ExportAxes axes) { return Eigen::Quaterniond(axis_rotation(axes)).normalized(); }

Skeleton unrotated_in_file(const Skeleton& skeleton, ExportAxes axes) {
  Skeleton result = skeleton;
  for (Eigen::Matrix4d& bind : result.bind) bind.topLeftCorner<3, 3>() = axis_rotation(axes).transpose();
  result.rest = bind_pose(result);
  return result;
}

}  // namespace anigen::io
