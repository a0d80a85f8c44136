#include "anigen/geometry/joint_names.h"

#include <gtest/gtest.h>

#include <limits>
#include <set>

#include "anigen/core/error.h"

namespace anigen::geometry {
namespace {

using Names = std::vector<std::string>;

/// A body along z, two arms, two legs, a tail to the back.
struct Biped {
  std::vector<Eigen::Vector3d> positions = {{0, 0, 1},         {0, 0, 1.5},     {0, 0, 2},  // spine
                                            {0.3, 0, 1.5},     {0.8, 0, 1.5},               // left arm, of 1
                                            {-0.3, 0.01, 1.5}, {-0.8, 0, 1.48},             // right arm, of 1
                                            {0.2, 0, 0.5},     {0.2, 0, -0.6},              // left leg, of 0
                                            {-0.2, 0, 0.5},    {-0.2, 0, -0.6},             // right leg, of 0
                                            {0, 0.3, 1},       {0.6, -0.2, 1.5}};           // tail; left thumb, of 3
  std::vector<int> parents = {-1, 0, 1, 1, 3, 1, 5, 0, 7, 0, 9, 0, 3};
};

TEST(JointNames, TellChainAndSide) {
  const Biped biped;
  // The legs lead farther than the spine, but they are two; the arms begin at the spine; the right hand has no thumb.
  EXPECT_EQ(
      joint_names(biped.positions, biped.parents),
      (Names{"chain_0_00", "chain_0_01", "chain_0_02", "chain_2.L_00", "chain_2.L_01", "chain_2.R_00", "chain_2.R_01",
             "chain_1.L_00", "chain_1.L_01", "chain_1.R_00", "chain_1.R_01", "chain_3_00", "chain_4_00"}));
}

TEST(JointNames, WithoutAMirrorImageTheLongestWayGoesOn) {
  const std::vector<Eigen::Vector3d> positions = {{0, 0, 0}, {0, 0, 1}, {1, 0, 0}, {2, 0, 0}, {0, 0, 1.5}};
  EXPECT_EQ(joint_names(positions, {-1, 0, 0, 2, 1}),
            (Names{"chain_0_00", "chain_1_00", "chain_0_01", "chain_0_02", "chain_1_01"}));
}

TEST(JointNames, SmallMovementsKeepThem) {
  Biped biped;
  const Names names = joint_names(biped.positions, biped.parents);
  for (std::size_t j = 0; j < biped.positions.size(); ++j) biped.positions[j].y() += 0.01 * static_cast<double>(j % 3);
  EXPECT_EQ(joint_names(biped.positions, biped.parents), names);
}

TEST(JointNames, WithoutExtentByIndex) {
  EXPECT_EQ(joint_names({{1, 1, 1}}, {-1}), Names{"joint_000"});
  EXPECT_EQ(joint_names({{1, 1, 1}, {1, 1, 1}}, {-1, 0}), (Names{"joint_000", "joint_001"}));
  EXPECT_TRUE(joint_names({}, {}).empty());
}

TEST(JointNames, RefuseWhatIsNoTree) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THROW(joint_names({{0, 0, 0}, {1, 0, 0}}, {-1}), InputError);
  EXPECT_THROW(joint_names({{0, 0, 0}, {1, 0, 0}}, {-1, 1}), InputError);
  EXPECT_THROW(joint_names({{0, 0, 0}, {nan, 0, 0}}, {-1, 0}), InputError);
}

}  // namespace
}  // namespace anigen::geometry
