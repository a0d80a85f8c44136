#include "anigen/asset/skinning.h"

#include <Eigen/LU>

namespace anigen {

std::vector<Eigen::Vector3f> skin_vertices(const Asset& asset, const std::vector<Eigen::Matrix4d>& world) {
  std::vector<Eigen::Matrix<double, 3, 4>> matrices(world.size());
  for (std::size_t j = 0; j < world.size(); ++j) {
    matrices[j] = (world[j] * asset.skeleton.bind[j].inverse()).topRows<3>();
  }
  std::vector<Eigen::Vector3f> posed(asset.mesh.vertices.size());
  for (std::size_t v = 0; v < posed.size(); ++v) {
    const Eigen::Vector4d vertex = asset.mesh.vertices[v].cast<double>().homogeneous();
    Eigen::Vector3d sum = Eigen::Vector3d::Zero();
    for (std::size_t i = 0; i < asset.skin.row_size(v); ++i) {
      const Influence& influence = asset.skin.row(v)[i];
      sum += static_cast<double>(influence.weight) * (matrices[static_cast<std::size_t>(influence.joint)] * vertex);
    }
    posed[v] = sum.cast<float>();
  }
  return posed;
}

std::vector<Eigen::Vector3f> skin_vertices(const Asset& asset, const Pose& pose) {
  return skin_vertices(asset, forward_kinematics(asset.skeleton.parents, pose));
}

}  // namespace anigen
