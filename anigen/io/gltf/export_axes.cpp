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

}  // namespace anigen::io
