#pragma once
#include <Eigen/Core>
#include <Eigen/Geometry>
#include <vector>

#include "anigen/asset/skeleton.h"
#include "anigen/io/gltf/container.h"
#include "anigen/io/gltf/document.h"

namespace anigen::io::gltf_import {

/// x → scale · rotation · x + translation; a negative scale mirrors. Multiplying a T · R · S transform from the left
/// by one of these gives a T · R · S transform again, exactly, so static nodes between joints can be folded away.
struct FoldedTransform {
  double scale = 1.0;
  Eigen::Quaterniond rotation = Eigen::Quaterniond::Identity();
  Eigen::Vector3d translation = Eigen::Vector3d::Zero();

  FoldedTransform operator*(const FoldedTransform& right) const;
  Transform operator*(const Transform& right) const;
  Eigen::Vector3d operator*(const Eigen::Vector3d& point) const;
  Eigen::Matrix4d matrix() const { return (*this * Transform()).matrix(); }
};

/// glTF's Y-up axes to ours, (X, Y, Z) → (X, −Z, Y): a rotation by 90° about X.
FoldedTransform y_up_to_z_up();

/// The one skeleton that all skins of a file are merged into, and where the file's nodes went.
struct Rig {
  Skeleton skeleton;                         ///< Z up through the root; `bind` is filled by bind_skins()
  std::vector<FoldedTransform> prefix;       ///< [J] what the folded nodes above a joint, and the axes at the root, put
                                             ///< before the joint's own T · R · S
  std::vector<int> joint_of_node;            ///< [N] or -1
  std::vector<int> nearest_joint;            ///< [N] the joint at or above a node, or -1
  std::vector<Eigen::Matrix4d> below_joint;  ///< [N] node → space of that joint; → glTF's world when there is none
  std::vector<char> skin_used;               ///< per skin of the file
};

/// Per node: 1 where an animation moves it away from the transform it rests in, else 0. Repairs of keyframes are noted.
/// @throws InputError when the animations have too many values
std::vector<char> moving_nodes(const Document& document, Notes& notes);

/// Chooses the joints (those of every skin in the scene; nodes above them that move or that scale unevenly; moving
/// nodes that carry rigid meshes), folds static nodes between them, and puts one root on top.
/// A scene without a skin may leave a rig without joints, as options.require_rig says.
/// @param moving per node, from moving_nodes()
/// @throws InputError when there is no skin and options.require_rig, or there are too many joints
Rig build_rig(const Document& document, const std::vector<char>& moving, const ImportOptions& options, Notes& notes);

/// Transforms of the vertices of one skin into the common bind pose.
struct SkinBinding {
  std::vector<int> joints;  ///< joint of the rig per entry of the skin; empty when the skin is not used
  Eigen::Matrix4d to_bind = Eigen::Matrix4d::Identity();  ///< A: the skin's mesh space → world, Z up
  /// Per entry C_j · IBM_j − A, where C is the common bind pose; empty when all are zero. Not zero when skins
  /// disagree about the bind pose of joints they share: a vertex then goes to Σ w (A + deviation_j) v.
  std::vector<Eigen::Matrix4d> deviation;
};

/// Chooses the world bind matrix C_j of every joint (written to rig.skeleton.bind) from the inverse bind matrices.
/// glTF fixes a bind pose only up to one matrix A per skin: C_j = A · IBM_j⁻¹. A puts the skin's top-most joint where
/// it rests; later skins take it from a joint that an earlier skin has placed. Joints without a usable inverse bind
/// matrix follow their parent as in the rest pose.
/// @throws InputError when no inverse bind matrix of a skin can be used
std::vector<SkinBinding> bind_skins(const Document& document, Rig& rig, Notes& notes);

}  // namespace anigen::io::gltf_import
