#pragma once
#include <Eigen/Core>
#include <array>
#include <string>
#include <vector>

#include "anigen/asset/skeleton.h"
#include "anigen/asset/skin_weights.h"
#include "anigen/rigging/human_bones.h"

namespace anigen::rigging {

/// Joints of a skeleton that are the bones of a human.
struct Humanoid {
  std::array<int, kHumanBones> joints;                  ///< by bone; -1 where there is none
  Eigen::Vector3d forward = -Eigen::Vector3d::UnitY();  ///< horizontal, unit; left = up × forward
  bool forward_is_known = false;  ///< of feet, knees or the sides that names tell; else −y was assumed
  bool by_names = false;          ///< names told the limbs; else tree and places alone

  Humanoid() { joints.fill(-1); }
  int operator[](std::size_t bone) const { return joints[bone]; }
  int operator[](HumanBone bone) const { return joints[index_of(bone)]; }
  /// Bone per joint, or -1. @param count of joints
  std::vector<int> bones(std::size_t count) const;
  /// The required bones that have no joint, in VRM's words.
  std::vector<std::string> missing() const;
};

enum class NameHints { kUsed, kIgnored };

/// Finds the bones of a standing humanoid, Z up. Legs are the mirrored pair of limbs that reaches lowest, arms the
/// first one above them that reaches to neither ground nor head, spine the way between the two; elbows and knees are
/// where a limb divides into two long bones of similar length, which passes over twist and end joints, hands are where
/// fingers begin. Names that are clear tell limbs before places do, as do rigs for IK whose legs or feet hang on the
/// root. Left and right are places, whatever names say: by toes, feet and knees the body faces somewhere.
/// @param weight per joint: sum of its skin weights; empty: unknown. Joints without any are passed over where there is
/// an other answer
/// @return bones as far as they were found; missing() says the others
Humanoid find_humanoid(const Skeleton& skeleton, const std::vector<double>& weight, NameHints hints = NameHints::kUsed);

/// Sum of the weights per joint.
std::vector<double> weight_of_joints(const SkinWeights& skin, std::size_t joints);

/// @throws InputError naming the missing bones @param what asks for a humanoid, such as "--names vrm"
void require_humanoid(const Humanoid& humanoid, const std::string& file, const std::string& what);

/// Parents of the joints in which every bone is below the bone that it needs (required_parent()), with as few changes
/// as that takes: rigs for IK hang legs and feet on the root. Not in the order of the joints.
std::vector<int> humanoid_parents(const std::vector<int>& parents, const Humanoid& humanoid);

}  // namespace anigen::rigging
