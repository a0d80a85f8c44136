#include "anigen/asset/joint_side.h"

#include <gtest/gtest.h>
#include <string>
#include <utility>

namespace anigen {

namespace {

using SidedName = std::pair<int, std::string>;

TEST(SideOfName, ReadsTheCustomsOfPrograms) {
  EXPECT_EQ(side_of_name("Hand.L"), SidedName(1, "hand.*"));
  EXPECT_EQ(side_of_name("hand.r"), SidedName(-1, "hand.*"));
  EXPECT_EQ(side_of_name("DEF_arm.L.001"), SidedName(1, "def_arm.*"));
  EXPECT_EQ(side_of_name("mixamorig:LeftUpLeg"), SidedName(1, "mixamorig:*upleg"));
  EXPECT_EQ(side_of_name("b_RightForeArm_07"), SidedName(-1, "b_*forearm"));
  EXPECT_EQ(side_of_name("HandRight"), SidedName(-1, "hand*"));
  EXPECT_EQ(side_of_name("L_Foot"), SidedName(1, "*_foot"));
  EXPECT_EQ(side_of_name("handFBXASC046L"), SidedName(1, "hand.*"));
  EXPECT_EQ(side_of_name("thumbFBXASC04601FBXASC046R"), SidedName(-1, "thumb.01.*"));
  EXPECT_EQ(side_of_name("chain_2_03_L"), SidedName(1, "chain_2_03_*"));  // joint_names()
  for (const char* name : {"", "lever", "bright", "Bird_Lwing", "Tail1", "upright", "roll", "FBXASC", "F2a"})
    EXPECT_FALSE(side_of_name(name).has_value()) << name;
}

TEST(SideOfName, KeepsNumbersThatTellJointsApart) {
  EXPECT_NE(side_of_name("Finger1.L"), side_of_name("Finger2.L"));
  EXPECT_EQ(side_of_name("pelvis.L_021")->second, side_of_name("pelvis.R_013")->second);
}

}  // namespace

}  // namespace anigen
