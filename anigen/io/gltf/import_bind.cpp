#include "anigen/io/gltf/import_bind.h"

#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "anigen/io/gltf/import_accessor.h"

namespace anigen::io::gltf_import {
namespace {

using Eigen::Matrix4d;

// Inverse bind matrices are 32-bit floats: a ratio of singular values below their noise means a collapsed axis.
bool is_usable(const Matrix4d& matrix) {
  if (!matrix.allFinite()) return false;
  const Eigen::Matrix3d linear = matrix.topLeftCorner<3, 3>();
  if (!(linear.norm() < 1e15)) return false;
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> squares(linear.transpose() * linear, Eigen::EigenvaluesOnly);
  const double least = squares.eigenvalues()[0], most = squares.eigenvalues()[2];
  return least > 1e-12 * most && least > 1e-30;
}

std::vector<Matrix4d> read_inverse_binds(const Document& document, const Skin& skin, Notes& notes) {
  std::vector<Matrix4d> matrices(skin.joints.size(), Matrix4d::Identity());
  if (skin.inverse_bind_accessor < 0) {
    notes.tally("missing_inverse_bind", "skins have no inverse bind matrices: identities stand for them");
    return matrices;
  }
  const std::vector<double> numbers = read_doubles(document, skin.inverse_bind_accessor, matrices.size());
  for (std::size_t k = 0; k < matrices.size(); ++k) {
    matrices[k] = Eigen::Map<const Matrix4d>(numbers.data() + 16 * k);
    if (matrices[k].allFinite() && (matrices[k].row(3) - Eigen::RowVector4d(0, 0, 0, 1)).cwiseAbs().maxCoeff() > 1e-3) {
      notes.tally("repaired_inverse_bind", "inverse bind matrices had a last row other than 0 0 0 1");
    }
    matrices[k].row(3) = Eigen::RowVector4d(0, 0, 0, 1);
  }
  return matrices;
}

// A joint can rest at scale 0 (hidden); the bind pose must stay invertible.
Matrix4d invertible_rest(const Transform& rest) {
  Transform local = rest;
  for (double& s : local.scale) {
    if (!(std::abs(s) > 1e-9)) s = 1.0;
  }
  return local.matrix();
}

class BindPose {
 public:
  explicit BindPose(const Skeleton& skeleton) : skeleton_(skeleton), bind_(skeleton.size()), is_set_(skeleton.size()) {}

  bool is_set(int joint) const { return is_set_[at(joint)]; }
  const Matrix4d& operator[](int joint) const { return bind_[at(joint)]; }
  void set(int joint, const Matrix4d& bind) {
    bind_[at(joint)] = bind;
    bind_[at(joint)].row(3) = Eigen::RowVector4d(0, 0, 0, 1);
    is_set_[at(joint)] = true;
  }
  // C of the nearest joint above that is set, followed by the rest transforms down to this one.
  Matrix4d from_parents(int joint) const {
    Matrix4d result = invertible_rest(skeleton_.rest[at(joint)]);
    for (int j = skeleton_.parents[at(joint)]; j >= 0; j = skeleton_.parents[at(j)]) {
      if (is_set(j)) return bind_[at(j)] * result;
      result = invertible_rest(skeleton_.rest[at(j)]) * result;
    }
    return result;
  }
  std::vector<Matrix4d> take() { return std::move(bind_); }

 private:
  const Skeleton& skeleton_;
  std::vector<Matrix4d> bind_;
  std::vector<bool> is_set_;
};

// A of one skin. Entries in the order of the rig come parents first.
Matrix4d skin_to_bind(const BindPose& pose, const std::vector<int>& joints, const std::vector<Matrix4d>& inverse,
                      const std::vector<char>& usable) {
  std::size_t top = joints.size(), shared = joints.size();
  for (std::size_t k = 0; k < joints.size(); ++k) {
    if (usable[k] == 0) continue;
    if (top == joints.size() || joints[k] < joints[top]) top = k;
    if (pose.is_set(joints[k]) && (shared == joints.size() || joints[k] < joints[shared])) shared = k;
  }
  if (shared < joints.size()) return pose[joints[shared]] * inverse[shared];
  return pose.from_parents(joints[top]) * inverse[top];
}

void note_rest_difference(const Skeleton& skeleton, Notes& notes) {
  const std::vector<Matrix4d> rest = forward_kinematics(skeleton.parents, skeleton.rest);
  Box box;
  for (const Eigen::Vector3d& p : skeleton.positions()) box.extend(p);
  std::size_t differ = 0;
  for (std::size_t j = 0; j < rest.size(); ++j) {
    const Matrix4d difference = rest[j] - skeleton.bind[j];
    const double moved = difference.topRightCorner<3, 1>().norm();
    const double turned = difference.topLeftCorner<3, 3>().norm() / skeleton.bind[j].topLeftCorner<3, 3>().norm();
    const double noise = 1e-9 * skeleton.bind[j].topRightCorner<3, 1>().norm();
    if (moved > 1e-3 * box.diagonal() + noise || turned > 1e-3) ++differ;
  }
  notes.tally("rest_pose_differs", "joints rest elsewhere than in the bind pose", differ);
}

}  // namespace

std::vector<SkinBinding> bind_skins(const Document& document, Rig& rig, Notes& notes) {
  std::vector<SkinBinding> bindings(document.skins.size());
  std::vector<std::vector<Matrix4d>> inverses(document.skins.size());
  std::vector<std::vector<char>> usable(document.skins.size());
  BindPose pose(rig.skeleton);
  for (std::size_t s = 0; s < bindings.size(); ++s) {
    if (rig.skin_used[s] == 0) continue;
    const Skin& skin = document.skins[s];
    SkinBinding& binding = bindings[s];
    for (const int node : skin.joints) binding.joints.push_back(rig.joint_of_node[at(node)]);
    inverses[s] = read_inverse_binds(document, skin, notes);
    for (const Matrix4d& matrix : inverses[s]) usable[s].push_back(is_usable(matrix) ? 1 : 0);
    const auto bad = static_cast<std::size_t>(std::count(usable[s].begin(), usable[s].end(), 0));
    if (bad == usable[s].size()) {
      throw InputError(document.file, skin.pointer + "/inverseBindMatrices",
                       "none of the inverse bind matrices can be inverted");
    }
    notes.tally("repaired_inverse_bind", "inverse bind matrices could not be inverted and follow the parent joint",
                bad);
    binding.to_bind = skin_to_bind(pose, binding.joints, inverses[s], usable[s]);
    for (std::size_t k = 0; k < skin.joints.size(); ++k) {
      if (usable[s][k] != 0 && !pose.is_set(binding.joints[k]))
        pose.set(binding.joints[k], binding.to_bind * inverses[s][k].inverse());
    }
  }
  for (int j = 0; j < static_cast<int>(rig.skeleton.size()); ++j) {
    if (!pose.is_set(j)) pose.set(j, pose.from_parents(j));
  }
  for (std::size_t s = 0; s < bindings.size(); ++s) {
    SkinBinding& binding = bindings[s];
    double largest = 0.0;
    for (std::size_t k = 0; k < binding.joints.size(); ++k) {
      Matrix4d deviation = Matrix4d::Zero();
      if (usable[s][k] != 0) deviation = pose[binding.joints[k]] * inverses[s][k] - binding.to_bind;
      largest = std::max(largest, deviation.norm() / binding.to_bind.norm());
      binding.deviation.push_back(deviation);
    }
    if (largest < 1e-9) binding.deviation.clear();
  }
  rig.skeleton.bind = pose.take();
  for (const Matrix4d& bind : rig.skeleton.bind) {
    if (!bind.allFinite()) throw InputError(document.file, "/skins", "the bind pose is not finite");
  }
  note_rest_difference(rig.skeleton, notes);
  return bindings;
}

}  // namespace anigen::io::gltf_import
