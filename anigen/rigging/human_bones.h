#pragma once
#include <array>
#include <cstddef>
#include <string>
#include <vector>

namespace anigen::rigging {

/// Bones of a humanoid, those of VRM 1.0 without eyes and jaw. Index = the central ones, then the limbs of the left and
/// of the right side, then the fingers of the left and of the right hand.
enum class HumanBone {
  kHips,
  kSpine,
  kChest,
  kUpperChest,
  kNeck,
  kHead,
  kLeftShoulder,
  kLeftUpperArm,
  kLeftLowerArm,
  kLeftHand,
  kLeftUpperLeg,
  kLeftLowerLeg,
  kLeftFoot,
  kLeftToes,
  kRightShoulder,
  kRightUpperArm,
  kRightLowerArm,
  kRightHand,
  kRightUpperLeg,
  kRightLowerLeg,
  kRightFoot,
  kRightToes,
  kLeftFirstFinger,  ///< thumb, index, middle, ring, little finger of three bones each, from the palm to the tip
  kRightFirstFinger = kLeftFirstFinger + 15,
  kEnd = kRightFirstFinger + 15
};

inline constexpr std::size_t kHumanBones = static_cast<std::size_t>(HumanBone::kEnd);
inline constexpr std::size_t index_of(HumanBone bone) { return static_cast<std::size_t>(bone); }

/// Counterpart of a bone on the other side; central bones are their own.
std::size_t mirrored_bone(std::size_t bone);

/// Bone of a limb on the right (side 1) for one on the left (side 0), a finger's likewise.
inline constexpr std::size_t on_side(HumanBone left, int side) {
  const std::size_t bone = index_of(left);
  return bone + static_cast<std::size_t>(side) * (bone >= index_of(HumanBone::kLeftFirstFinger) ? 15 : 8);
}

/// The bone that has to be above it in the tree, the nearest one that a humanoid cannot lack; kHumanBones for the hips.
std::size_t required_parent(std::size_t bone);

/// True for the 15 bones without which VRM, Unity and Unreal take no skeleton for a humanoid.
bool is_required(std::size_t bone);

/// Customs by which joints are called.
enum class NameStyle {
  kChain,   ///< joint_names(): any creature
  kVrm,     ///< "leftUpperArm"
  kMixamo,  ///< "mixamorig:LeftArm"
  kUnreal,  ///< "upperarm_l", of the mannequin
  kUnity    ///< "LeftUpperArm", HumanBodyBones
};

/// "chain", "vrm", "mixamo", "unreal", "unity".
std::vector<std::string> name_style_words();
/// @throws InputError for another word, naming all of them
NameStyle parse_name_style(const std::string& word);

/// Name of a bone. @pre style is not kChain
std::string bone_name(std::size_t bone, NameStyle style);

}  // namespace anigen::rigging
