#pragma once
#include <Eigen/Core>
#include <Eigen/Geometry>
#include <string>
#include <vector>

namespace anigen {

/// Translation, rotation and scale of a joint relative to its parent; matrix() = T · R · S as in glTF.
struct Transform {
  Eigen::Vector3d translation = Eigen::Vector3d::Zero();
  Eigen::Quaterniond rotation = Eigen::Quaterniond::Identity();
  Eigen::Vector3d scale = Eigen::Vector3d::Ones();
  Eigen::Matrix4d matrix() const;
};

/// Nearest T · R · S of an affine matrix (polar decomposition; a mirroring goes into the scale's x).
/// @param shear_error set to the largest entry of |matrix - result.matrix()| relative to the matrix' scale
Transform decompose(const Eigen::Matrix4d& matrix, double* shear_error = nullptr);

/// A rooted tree of joints, parents before children: parents[0] = -1 and parents[j] < j for every other j.
/// All arrays have one entry per joint. World frame: right-handed, Z up.
struct Skeleton {
  std::vector<std::string> names;  ///< unique, not empty
  std::vector<int> parents;
  std::vector<Eigen::Matrix4d> bind;  ///< joint → world in the bind pose; its inverse is glTF's inverse bind matrix
  std::vector<Transform> rest;        ///< relative to the parent (to the world for the root): the file's rest pose,
                                      ///< which animations start from and which may differ from the bind pose

  std::size_t size() const { return parents.size(); }
  /// Joint positions in the bind pose, [J], world frame.
  std::vector<Eigen::Vector3d> positions() const;
};

/// One pose: a transform relative to the parent per joint.
using Pose = std::vector<Transform>;

/// World matrix of every joint, [J]. @pre pose has one entry per joint and parents come before children.
std::vector<Eigen::Matrix4d> forward_kinematics(const std::vector<int>& parents, const Pose& pose);

/// The bind pose as transforms relative to the parent (shear, if any, is dropped).
Pose bind_pose(const Skeleton& skeleton);

/// A skeleton without orientation: identity rotations at the given joint positions, rest = bind.
Skeleton skeleton_from_joints(const std::vector<Eigen::Vector3d>& positions, const std::vector<int>& parents,
                              const std::vector<std::string>& names = {});

}  // namespace anigen
