#include "anigen/asset/skeleton.h"

#include <Eigen/LU>
#include <Eigen/SVD>

namespace anigen {

Eigen::Matrix4d Transform::matrix() const {
  Eigen::Matrix4d m = Eigen::Matrix4d::Identity();
  m.topLeftCorner<3, 3>() = rotation.toRotationMatrix() * scale.asDiagonal();
  m.topRightCorner<3, 1>() = translation;
  return m;
}

Transform decompose(const Eigen::Matrix4d& matrix, double* shear_error) {
  const Eigen::Matrix3d linear = matrix.topLeftCorner<3, 3>();
  Transform result;
  result.translation = matrix.topRightCorner<3, 1>();
  // Without shear the columns are orthogonal and their lengths are the scale; that keeps exact inputs exact where
  // the polar factor would only come close.
  const Eigen::Vector3d lengths = linear.colwise().norm();
  const double largest = lengths.maxCoeff();
  Eigen::Matrix3d rotation = Eigen::Matrix3d::Identity();
  if (lengths.minCoeff() > 1e-12 * largest && largest > 0.0) {
    const Eigen::Matrix3d directions = linear * lengths.cwiseInverse().asDiagonal();
    const double skew = (directions.transpose() * directions - Eigen::Matrix3d::Identity()).cwiseAbs().maxCoeff();
    const Eigen::JacobiSVD<Eigen::Matrix3d> svd(skew < 1e-9 ? directions : linear,
                                                Eigen::ComputeFullU | Eigen::ComputeFullV);
    rotation = svd.matrixU() * svd.matrixV().transpose();
    result.scale = skew < 1e-9 ? lengths : Eigen::Vector3d((rotation.transpose() * linear).diagonal());
  } else {
    // A collapsed axis: the orientation is only partly defined.
    const Eigen::JacobiSVD<Eigen::Matrix3d> svd(linear, Eigen::ComputeFullU | Eigen::ComputeFullV);
    rotation = svd.matrixU() * svd.matrixV().transpose();
    result.scale = (rotation.transpose() * linear).diagonal();
  }
  if (rotation.determinant() < 0.0) {
    rotation.col(0) = -rotation.col(0);
    result.scale.x() = -result.scale.x();
  }
  result.rotation = Eigen::Quaterniond(rotation).normalized();
  if (shear_error != nullptr) {
    const Eigen::Matrix4d difference = matrix - result.matrix();
    *shear_error = difference.topLeftCorner<3, 3>().cwiseAbs().maxCoeff() / (largest > 0.0 ? largest : 1.0);
  }
  return result;
}

std::vector<Eigen::Vector3d> Skeleton::positions() const {
  std::vector<Eigen::Vector3d> result;
  result.reserve(bind.size());
  for (const Eigen::Matrix4d& m : bind) result.emplace_back(m.topRightCorner<3, 1>());
  return result;
}

std::vector<Eigen::Matrix4d> forward_kinematics(const std::vector<int>& parents, const Pose& pose) {
  std::vector<Eigen::Matrix4d> world(parents.size());
  for (std::size_t j = 0; j < parents.size(); ++j) {
    const Eigen::Matrix4d local = pose[j].matrix();
    world[j] = parents[j] < 0 ? local : Eigen::Matrix4d(world[static_cast<std::size_t>(parents[j])] * local);
  }
  return world;
}

Pose bind_pose(const Skeleton& skeleton) {
  Pose pose(skeleton.size());
  for (std::size_t j = 0; j < skeleton.size(); ++j) {
    const int parent = skeleton.parents[j];
    pose[j] = decompose(
        parent < 0 ? skeleton.bind[j]
                   : Eigen::Matrix4d(skeleton.bind[static_cast<std::size_t>(parent)].inverse() * skeleton.bind[j]));
  }
  return pose;
}

Skeleton skeleton_from_joints(const std::vector<Eigen::Vector3d>& positions, const std::vector<int>& parents,
                              const std::vector<std::string>& names) {
  Skeleton skeleton;
  skeleton.parents = parents;
  for (std::size_t j = 0; j < positions.size(); ++j) {
    skeleton.names.push_back(names.empty() ? "joint_" + std::to_string(j) : names[j]);
    Transform world, local;
    world.translation = positions[j];
    local.translation =
        parents[j] < 0 ? positions[j] : Eigen::Vector3d(positions[j] - positions[static_cast<std::size_t>(parents[j])]);
    skeleton.bind.push_back(world.matrix());
    skeleton.rest.push_back(local);
  }
  return skeleton;
}

}  // namespace anigen
