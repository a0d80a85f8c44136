#include "anigen/rigging/humanoid.h"

#include <gtest/gtest.h>
#include <Eigen/Geometry>
#include <algorithm>
#include <string>
#include <utility>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "anigen/rigging/humanoid_names.h"
#include "tests/rigging/human_rig.h"
#include "tests/support/paths.h"
#include "tests/support/rig_files.h"

namespace anigen::rigging {

namespace {

using test::HumanRig;

/// Words of HumanRig by bone, those of the left for both sides.
std::vector<std::pair<std::size_t, std::string>> expected_bones() {
  std::vector<std::pair<std::size_t, std::string>> bones = {{index_of(HumanBone::kHips), "hips"},
                                                            {index_of(HumanBone::kSpine), "spine"},
                                                            {index_of(HumanBone::kChest), "chest"},
                                                            {index_of(HumanBone::kNeck), "neck"},
                                                            {index_of(HumanBone::kHead), "head"}};
  const std::pair<HumanBone, const char*> limbs[] = {
      {HumanBone::kLeftShoulder, "shoulder"},  {HumanBone::kLeftUpperArm, "upper_arm"},
      {HumanBone::kLeftLowerArm, "lower_arm"}, {HumanBone::kLeftHand, "hand"},
      {HumanBone::kLeftUpperLeg, "upper_leg"}, {HumanBone::kLeftLowerLeg, "lower_leg"},
      {HumanBone::kLeftFoot, "foot"},          {HumanBone::kLeftToes, "toes"}};
  for (const int side : {0, 1}) {
    for (const auto& [bone, word] : limbs)
      bones.emplace_back(on_side(bone, side), (side == 0 ? "l_" : "r_") + std::string(word));
  }
  return bones;
}

void expect_person(const Humanoid& found, const HumanRig& rig) {
  for (const auto& [bone, word] : expected_bones()) {
    EXPECT_EQ(found[bone], rig.index(word)) << bone_name(bone, NameStyle::kVrm);
  }
  EXPECT_TRUE(found.missing().empty());
}

TEST(FindHumanoid, ReadsTreeAndPlacesOfUnknownNames) {
  const HumanRig rig;
  const Humanoid found = find_humanoid(rig.skeleton(), rig.weight());
  expect_person(found, rig);
  EXPECT_FALSE(found.by_names);
  EXPECT_LT((found.forward + Eigen::Vector3d::UnitY()).norm(), 0.05);
}

TEST(FindHumanoid, NeedsNoWeights) { expect_person(find_humanoid(HumanRig().skeleton(), {}), HumanRig()); }

// Names are hints: sides are where the body has them, and toes tell which way it faces.
TEST(FindHumanoid, TellsSidesByPlaces) {
  HumanRig rig;
  for (HumanRig::Joint& joint : rig.joints) joint.place.x() = -joint.place.x();  // called left, but on the right
  for (const bool named : {false, true}) {
    const Humanoid found = find_humanoid(rig.skeleton(named), rig.weight());
    EXPECT_EQ(found[HumanBone::kLeftHand], rig.index("r_hand")) << named;
    EXPECT_EQ(found[HumanBone::kRightFoot], rig.index("l_foot")) << named;
  }
  const Eigen::Matrix3d turn = Eigen::AngleAxisd(0.5 * EIGEN_PI, Eigen::Vector3d::UnitZ()).toRotationMatrix();
  const Humanoid turned = find_humanoid(HumanRig().skeleton(false, turn), rig.weight());
  expect_person(turned, HumanRig());
  EXPECT_LT((turned.forward - Eigen::Vector3d::UnitX()).norm(), 0.05) << "−y turned by 90 degrees";
}

TEST(FindHumanoid, FeetOfIkRigsHangElsewhere) {
  HumanRig rig;
  for (const std::string side : {"l_", "r_"}) {
    rig[side + "foot"].parent = "root";
    rig[side + "upper_leg"].parent = "root";
  }
  for (const bool named : {false, true}) {
    const Skeleton skeleton = rig.skeleton(named);
    const Humanoid found = find_humanoid(skeleton, rig.weight());
    ASSERT_TRUE(found.missing().empty()) << named;
    EXPECT_EQ(found[HumanBone::kLeftFoot], rig.index("l_foot"));
    EXPECT_EQ(found[HumanBone::kHips], rig.index("hips"));
    const std::vector<int> parents = humanoid_parents(skeleton.parents, found);
    EXPECT_EQ(parents[at(rig.index("l_foot"))], rig.index("l_lower_leg"));
    EXPECT_EQ(parents[at(rig.index("r_upper_leg"))], rig.index("hips"));
    EXPECT_EQ(parents[at(rig.index("l_hand"))], rig.index("l_lower_arm")) << "the others stay";
  }
  const HumanRig plain;
  EXPECT_EQ(humanoid_parents(plain.skeleton().parents, find_humanoid(plain.skeleton(), {})), plain.skeleton().parents);
}

TEST(FindHumanoid, AFourLeggedAnimalIsNone) {
  HumanRig rig;  // bent forward until the hands are feet
  for (HumanRig::Joint& joint : rig.joints) {
    const bool arm = joint.word.find("hand") != std::string::npos || joint.word.find("arm") != std::string::npos;
    if (joint.place.z() > 1.0) joint.place = {joint.place.x() * (arm ? 0.1 : 1.0), -(joint.place.z() - 1.0), 0.95};
    if (arm) joint.place.z() = joint.word.find("hand") != std::string::npos ? 0.05 : 0.5;
  }
  for (const bool named : {false, true}) {
    const Humanoid found = find_humanoid(rig.skeleton(named), rig.weight());
    ASSERT_FALSE(found.missing().empty()) << named;
    const std::string message = test::refusal([&] { require_humanoid(found, "fox.glb", "VRM"); });
    EXPECT_NE(message.find("head"), std::string::npos) << message;
  }
}

TEST(FindHumanoid, AnythingElseIsNone) {
  EXPECT_EQ(find_humanoid(skeleton_from_joints({{0, 0, 0}}, {-1}), {}).missing().size(), 15u);
  EXPECT_EQ(find_humanoid(skeleton_from_joints({{0, 0, 0}, {0, 0, 1}, {0, 0, 2}}, {-1, 0, 1}), {}).missing().size(),
            15u);
  EXPECT_EQ(find_humanoid(Skeleton(), {}).missing().size(), 15u);
  EXPECT_THROW(find_humanoid(HumanRig().skeleton(), {1.0}), InputError);
}

TEST(NamedBone, ReadsTheCustomsOfPrograms) {
  const auto limb = [](const std::string& name) {
    const NamedBone found = named_bone(name);
    return found.kind == NamedBone::Kind::kLimb ? bone_name(on_side(found.bone, found.side), NameStyle::kVrm) : "";
  };
  EXPECT_EQ(limb("mixamorig:LeftUpLeg"), "leftUpperLeg");
  EXPECT_EQ(limb("mixamorig:RightArm"), "rightUpperArm");
  EXPECT_EQ(limb("upperarm_l"), "leftUpperArm");
  EXPECT_EQ(limb("DEF-shin.R"), "rightLowerLeg");
  EXPECT_EQ(limb("J_Bip_L_UpperArm"), "leftUpperArm");
  EXPECT_EQ(limb("Bip01 R Thigh"), "rightUpperLeg");
  EXPECT_EQ(limb("forearmFBXASC046L"), "leftLowerArm");
  EXPECT_EQ(limb("LeftForeArm"), "leftLowerArm");
  for (const char* name :
       {"kneeIK.l", "PoleTarget.L", "LowerLeg.L_end", "upperarm_twist_01_l", "Wing.L", "Armor_L", "L"})
    EXPECT_EQ(limb(name), "") << name;
  EXPECT_EQ(named_bone("Hips").kind, NamedBone::Kind::kCentral);
  EXPECT_EQ(named_bone("DEF_hips.R.001").kind, NamedBone::Kind::kNone) << "half of a pelvis";
  EXPECT_EQ(named_bone("LeftHandIndex1").kind, NamedBone::Kind::kFinger);
}

TEST(BoneNames, AreDifferentInEveryCustomAndReadBack) {
  for (const NameStyle style : {NameStyle::kVrm, NameStyle::kMixamo, NameStyle::kUnreal, NameStyle::kUnity}) {
    std::vector<std::string> names;
    for (std::size_t bone = 0; bone < kHumanBones; ++bone) names.push_back(bone_name(bone, style));
    std::vector<std::string> unique = names;
    std::sort(unique.begin(), unique.end());
    EXPECT_EQ(std::unique(unique.begin(), unique.end()), unique.end());
    for (std::size_t bone = 0; bone < kHumanBones; ++bone) {
      if (!is_required(bone) || bone == index_of(HumanBone::kSpine)) continue;
      const NamedBone found = named_bone(names[bone]);
      const bool central = found.kind == NamedBone::Kind::kCentral;
      EXPECT_EQ(central ? index_of(found.bone) : on_side(found.bone, found.side), bone) << names[bone];
    }
  }
  EXPECT_EQ(bone_name(on_side(HumanBone::kLeftFirstFinger, 1), NameStyle::kVrm), "rightThumbMetacarpal");
  EXPECT_EQ(bone_name(on_side(HumanBone::kLeftFirstFinger, 0) + 4, NameStyle::kUnreal), "index_02_l");
  EXPECT_EQ(bone_name(on_side(HumanBone::kLeftFirstFinger, 1) + 14, NameStyle::kMixamo), "mixamorig:RightHandPinky3");
}

}  // namespace

}  // namespace anigen::rigging
