#include "anigen/rigging/engine_rig.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <set>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "anigen/io/gltf/export.h"

namespace anigen::rigging {

namespace {

/// Part of the height within which a joint without weights is at the origin already.
constexpr double kAtOrigin = 0.05;

/// A name that no joint has.
std::string free_name(const std::string& wanted, const std::set<std::string>& taken) {
  std::string name = wanted;
  for (int i = 1; taken.count(name) > 0; ++i) name = wanted + "_" + std::to_string(i);
  return name;
}

/// Names by a custom; joints that are no bones of it keep theirs as far as these are free.
std::vector<std::string> styled_names(const Skeleton& skeleton, const Humanoid& humanoid, NameStyle style) {
  if (style == NameStyle::kChain) return joint_names(skeleton.positions(), skeleton.parents);
  std::vector<std::string> names(skeleton.size());
  std::set<std::string> taken;
  const std::vector<int> bones = humanoid.bones(skeleton.size());
  for (std::size_t j = 0; j < names.size(); ++j) {
    if (bones[j] >= 0) taken.insert(names[j] = bone_name(at(bones[j]), style));
  }
  for (std::size_t j = 0; j < names.size(); ++j) {
    if (bones[j] < 0) taken.insert(names[j] = free_name(skeleton.names[j], taken));
  }
  return names;
}

/// Puts a tree into an order with parents first; siblings keep theirs.
void rearrange(EngineRig& rig, const std::vector<int>& parents) {
  const JointTree tree{rig.skeleton.positions(), parents};
  const std::vector<int> order = parents_first(tree);
  std::vector<int> place(order.size());
  for (std::size_t i = 0; i < order.size(); ++i) place[at(order[i])] = static_cast<int>(i);
  const Skeleton before = rig.skeleton;
  for (std::size_t i = 0; i < order.size(); ++i) {
    const std::size_t old = at(order[i]);
    rig.skeleton.names[i] = before.names[old];
    rig.skeleton.parents[i] = parents[old] < 0 ? -1 : place[at(parents[old])];
    rig.skeleton.bind[i] = before.bind[old];
  }
  rig.skeleton.rest = bind_pose(rig.skeleton);
  for (int& joint : rig.new_joint) joint = place[at(joint)];
  for (int& joint : rig.humanoid.joints) joint = joint < 0 ? -1 : place[at(joint)];
}

void add_root_bone(EngineRig& rig, double height, const std::vector<double>& weight) {
  Skeleton& skeleton = rig.skeleton;
  const auto given = std::find(rig.new_joint.begin(), rig.new_joint.end(), 0) - rig.new_joint.begin();
  const bool is_idle = !weight.empty() && !(weight[static_cast<std::size_t>(given)] > 0.0);
  const Eigen::Vector3d first = skeleton.bind.front().topRightCorner<3, 1>();
  if (is_idle && first.norm() <= kAtOrigin * height) {
    rig.note += std::string(rig.note.empty() ? "" : ", ") + "has a root bone already";
    return;
  }
  rig.has_given_joints = false;
  Skeleton origin =
      io::unrotated_in_file(skeleton_from_joints({Eigen::Vector3d::Zero()}, {-1}, {"root"}), io::ExportAxes::kGltf);
  origin.names[0] = free_name("root", {skeleton.names.begin(), skeleton.names.end()});
  for (std::size_t j = 0; j < skeleton.size(); ++j) {
    origin.names.push_back(skeleton.names[j]);
    origin.parents.push_back(skeleton.parents[j] + 1);
    origin.bind.push_back(skeleton.bind[j]);
  }
  origin.rest = bind_pose(origin);
  skeleton = std::move(origin);
  for (int& joint : rig.new_joint) ++joint;
  for (int& joint : rig.humanoid.joints) joint = joint < 0 ? -1 : joint + 1;
}

/// Rotation about z by quarter turns after which a body faces −y as nearly as that allows.
Eigen::Matrix3d facing_turn(const Eigen::Vector3d& forward) {
  const double angle = std::atan2(forward.x(), -forward.y());  // from −y towards +x
  const auto quarters = static_cast<int>(std::lround(angle / (0.5 * EIGEN_PI)));
  Eigen::Matrix3d turn = Eigen::Matrix3d::Identity(), quarter;
  quarter << 0, 1, 0, -1, 0, 0, 0, 0, 1;  // +x → −y
  for (int i = 0; i < (quarters % 4 + 4) % 4; ++i) turn = quarter * turn;
  return turn;
}

/// Rotation, scale and translation of the mesh and its box.
Eigen::Matrix4d placement_of(const EngineRig& rig, const Box& box, const EngineOptions& options,
                             const std::string& file) {
  Eigen::Matrix4d placement = Eigen::Matrix4d::Identity();
  Eigen::Matrix3d turn = Eigen::Matrix3d::Identity();
  if (options.humanoid && rig.humanoid.forward_is_known) turn = facing_turn(rig.humanoid.forward);
  const double extent = box.empty() ? 0.0 : box.high.z() - box.low.z();
  double scale = 1.0;
  if (options.height > 0.0) {
    if (!(extent > 0.0) || !std::isfinite(options.height / extent))
      throw InputError(file, "--height", "the mesh has no height that could be scaled");
    scale = options.height / extent;
  }
  placement.topLeftCorner<3, 3>() = scale * turn;
  if (!options.ground || box.empty()) return placement;
  const int hips = rig.humanoid[HumanBone::kHips];
  const Eigen::Vector3d root = rig.skeleton.bind[at(std::max(hips, 0))].topRightCorner<3, 1>();
  const Eigen::Vector3d below(root.x(), root.y(), box.low.z());
  placement.topRightCorner<3, 1>() = -(scale * turn * below);
  return placement;
}

/// Joints moved by a similarity: their scale stays, as apply(Similarity) leaves it, too.
void place_joints(const Eigen::Matrix4d& placement, Skeleton& skeleton) {
  const Eigen::Matrix3d linear = placement.topLeftCorner<3, 3>();
  const Eigen::Matrix3d turn = linear / linear.col(0).norm();
  for (Eigen::Matrix4d& bind : skeleton.bind) {
    const Eigen::Vector4d place = placement * bind.col(3);
    bind.topLeftCorner<3, 3>() = (turn * bind.topLeftCorner<3, 3>()).eval();
    bind.col(3) = place;
  }
  skeleton.rest = bind_pose(skeleton);
}

}  // namespace

EngineRig engine_rig(const Skeleton& skeleton, const Box& box, const std::vector<double>& weight,
                     const EngineOptions& options, const std::string& file) {
  EngineRig rig;
  rig.skeleton = skeleton;
  for (std::size_t j = 0; j < skeleton.size(); ++j) rig.new_joint.push_back(static_cast<int>(j));
  const bool has_human_names = options.names && *options.names != NameStyle::kChain;
  const Humanoid found = find_humanoid(skeleton, weight);
  rig.has_given_joints = !options.axes;
  if (has_human_names || options.humanoid) {
    require_humanoid(found, file, options.humanoid ? "VRM" : "--names of an engine");
    rig.humanoid = found;
    const std::vector<int> parents = humanoid_parents(skeleton.parents, found);
    if (parents != skeleton.parents) {
      rig.note = "limbs hung on the body";
      rig.has_given_joints = false;
      rearrange(rig, parents);
    }
  }
  rig.placement = placement_of(rig, box, options, file);
  if (rig.placement != Eigen::Matrix4d::Identity()) {
    place_joints(rig.placement, rig.skeleton);
    rig.has_given_joints = false;
  }
  Eigen::Vector3d forward = -Eigen::Vector3d::UnitY();
  if (found.missing().empty()) forward = rig.placement.topLeftCorner<3, 3>() * found.forward;
  if (options.axes) rig.skeleton = with_bone_axes(rig.skeleton, *options.axes, forward.normalized());
  rig.humanoid.forward = forward.normalized();
  if (options.names) rig.skeleton.names = styled_names(rig.skeleton, rig.humanoid, *options.names);
  const double height = box.empty() ? 0.0 : (box.high.z() - box.low.z()) * std::cbrt(rig.placement.determinant());
  if (options.root_bone) add_root_bone(rig, height, weight);
  return rig;
}

SkinWeights with_new_joints(SkinWeights skin, const EngineRig& rig) {
  for (Influence& influence : skin.influences) influence.joint = rig.new_joint[at(influence.joint)];
  return skin;
}

void apply(const EngineRig& rig, Asset& asset) {
  const Eigen::Matrix3d linear = rig.placement.topLeftCorner<3, 3>();
  const Eigen::Vector3d offset = rig.placement.topRightCorner<3, 1>();
  for (Eigen::Vector3f& vertex : asset.mesh.vertices) vertex = (linear * vertex.cast<double>() + offset).cast<float>();
  for (Eigen::Vector3f& normal : asset.mesh.normals) {
    const Eigen::Vector3d turned = linear * normal.cast<double>();
    if (turned.norm() > 0.0) normal = turned.normalized().cast<float>();
  }
  asset.skin = with_new_joints(std::move(asset.skin), rig);
  asset.skeleton = rig.skeleton;
  asset.animations.clear();
}

}  // namespace anigen::rigging
