#pragma once
#include <Eigen/Core>
#include <vector>

#include "anigen/asset/skin_weights.h"

namespace anigen::loaders {

/// A skeleton as Anymate's data describe one: bones with two ends, and the joints that these ends are (reference
/// anymate-baselines.md, 1.2 and 1.5). Some links between joints are no bones: those from the end of a bone with
/// several children to these.
struct BoneLayout {
  std::vector<Eigen::Vector3f> joints;        ///< [J] ends of bones, each position once, heads first
  std::vector<int> conns;                     ///< [J] parent of each joint; a root's own index
  std::vector<Eigen::Vector3f> heads, tails;  ///< [K]
  std::vector<int> bone_of;                   ///< [joints of the rig] the bone that carries its weights, -1: none
};

/// Joints that nothing hangs on go first, their children to their parents (reference, 1.3, item 4). Then every joint is
/// the head of a bone. Its tail is its child where it has one child; with none or several it points where its weights
/// are, seen from its head, a quarter farther than their mean.
/// @param joints [Jr] the rig's @param parents [Jr], -1 for a root @param used [Jr] whether the mesh hangs on it
/// @param points [P] on the surface @param skin [P] rows over the rig's joints
/// @throws InputError when no joint is used, when two bones end at one point, or when an end of a bone would have
///   two parents: such rigs are rejected, as published
BoneLayout lay_out_bones(const std::vector<Eigen::Vector3f>& joints, const std::vector<int>& parents,
                         const std::vector<bool>& used, const std::vector<Eigen::Vector3f>& points,
                         const SkinWeights& skin);

}  // namespace anigen::loaders
