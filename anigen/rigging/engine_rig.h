#pragma once
#include <Eigen/Core>
#include <optional>
#include <string>
#include <vector>

#include "anigen/asset/mesh.h"
#include "anigen/asset/rigged_asset.h"
#include "anigen/asset/skeleton.h"
#include "anigen/rigging/bone_axes.h"
#include "anigen/rigging/human_bones.h"
#include "anigen/rigging/humanoid.h"

namespace anigen::rigging {

/// Demands of an engine on a rig.
struct EngineOptions {
  std::optional<BoneAxes> axes;    ///< unset: joints keep theirs
  std::optional<NameStyle> names;  ///< unset: joints keep theirs
  double height = 0.0;             ///< metres from the lowest to the highest vertex; 0: the size stays
  bool ground = false;             ///< the lowest vertex comes to z = 0, the root (of a humanoid the hips) to x = y = 0
  bool root_bone = false;          ///< a joint without weights at the origin above all others
  bool humanoid = false;           ///< the bones of a human are needed, in a tree as humans have, the body facing −y

  bool any() const { return axes || names || height > 0.0 || ground || root_bone || humanoid; }
};

/// A skeleton as an engine wants it.
struct EngineRig {
  Skeleton skeleton;           ///< after `placement`
  std::vector<int> new_joint;  ///< joint of `skeleton` per joint of the one that was given
  Humanoid humanoid;           ///< in `skeleton`; empty where neither names nor options ask for one
  Eigen::Matrix4d placement = Eigen::Matrix4d::Identity();  ///< for the mesh: rotation about z, scale, translation
  /// True where joints, their tree, places and axes are those that were given: names alone are new.
  bool has_given_joints = false;
  std::string note;  ///< for the report; may be empty
};

/// @param box of the mesh in its bind pose @param weight per joint, as find_humanoid() takes it
/// @param file for messages
/// @throws InputError naming the bones that a humanoid lacks, or for a box without height where one is asked for
EngineRig engine_rig(const Skeleton& skeleton, const Box& box, const std::vector<double>& weight,
                     const EngineOptions& options, const std::string& file);

/// The asset with the rig of its skeleton: vertices and normals placed, weights under the new joints, no animations.
void apply(const EngineRig& rig, Asset& asset);

/// Weights under the new joints.
SkinWeights with_new_joints(SkinWeights skin, const EngineRig& rig);

}  // namespace anigen::rigging
