#include "anigen/asset/joint_side.h"

#include <gtest/gtest.h>

namespace anigen {

namespace {

void expect(const char* name, int side, const char* stem) {
  EXPECT_EQ(side_of_name(name).side, side) << name;
  EXPECT_EQ(side_of_name(name).stem, stem) << name;
}

TEST(SideOfName, ReadsTheCustomsOfPrograms) {
  expect("Hand.L", 1, "hand.*");
  expect("hand.r", -1, "hand.*");
  expect("DEF_arm.L.001", 1, "def_arm.*");
  expect("mixamorig:LeftUpLeg", 1, "mixamorig:*upleg");
  expect("b_RightForeArm_07", -1, "b_*forearm");
  expect("HandRight", -1, "hand*");
  expect("L_Foot", 1, "*_foot");
  expect("handFBXASC046L", 1, "hand.*");
  expect("thumbFBXASC04601FBXASC046R", -1, "thumb.01.*");
  expect("chain_2_03_L", 1, "chain_2_03_*");  // joint_names()
  expect("b_RightLeg01_019", -1, "b_*leg");
  expect("legL", 1, "leg*");
  expect("FinR_03", -1, "fin*");
  for (const char* name :
       {"", "lever", "bright", "Bird_Lwing", "Tail1", "upright", "roll", "FBXASC", "F2a", "LowerLeg", "TAIL"})
    EXPECT_EQ(side_of_name(name).side, 0) << name;
}

TEST(SideOfName, KeepsNumbersThatTellJointsApart) {
  EXPECT_NE(side_of_name("Finger1.L").stem, side_of_name("Finger2.L").stem);
  EXPECT_NE(side_of_name("finger_l_01").rest, side_of_name("finger_l_02").rest);
  EXPECT_EQ(side_of_name("pelvis.L_021").stem, side_of_name("pelvis.R_013").stem);
}

}  // namespace

}  // namespace anigen
