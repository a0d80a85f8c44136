#pragma once
#include <array>
#include <string>
#include <vector>

#include "anigen/rigging/human_bones.h"

namespace anigen::rigging {

/// A bone that a joint's name tells, of the side that the name tells.
struct NamedBone {
  enum class Kind { kNone, kCentral, kLimb, kFinger } kind = Kind::kNone;
  HumanBone bone = HumanBone::kEnd;  ///< of the left side for limbs; the first phalanx for fingers
  int side = 0;                      ///< 0 left, 1 right
};

/// Reads "mixamorig:LeftUpLeg", "upperarm_l", "DEF-shin.R", "J_Bip_L_UpperArm", "Bip01 R Thigh", "forearmFBXASC046L".
/// Nothing for twist, end and control joints, and for words that other creatures have, too.
NamedBone named_bone(const std::string& name);

/// True for a name that says end, tip, twist, helper or control.
bool names_helper(const std::string& name);

/// Joints that clear names tell, by bone; -1 where none does. Of several for one bone the first with weights. Fingers
/// are counted from the palm on.
/// @param carries per joint: has skin weights; empty: unknown
std::array<int, kHumanBones> joints_by_name(const std::vector<std::string>& names, const std::vector<int>& parents,
                                            const std::vector<char>& carries);

}  // namespace anigen::rigging
