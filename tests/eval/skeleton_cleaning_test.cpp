#include <gtest/gtest.h>

#include "anigen/core/error.h"
#include "anigen/eval/skeleton/puppeteer_cleaning.h"
#include "anigen/eval/skeleton/skeleton_chamfer.h"

namespace anigen::eval {
namespace {

using Bones = std::vector<std::array<int, 2>>;

TEST(PuppeteerCleaning, LeavesACleanTreeAsItIs) {
  const io::JointTree tree{{{0, 0, 0}, {0.1, 0, 0}, {0.2, 0, 0}}, {-1, 0, 1}};
  const JointGraph clean = puppeteer_cleaned(tree);
  EXPECT_EQ(clean.joints, tree.positions);
  EXPECT_EQ(clean.bones, (Bones{{0, 1}, {1, 2}}));
}

TEST(PuppeteerCleaning, MergesNearJointsIntoTheFirst) {
  // 1 and 2 are 0.002 apart, and the bone between them goes; 3 hangs on the merged joint now.
  const io::JointTree tree{{{0, 0, 0}, {0.1, 0, 0}, {0.102, 0, 0}, {0.2, 0, 0}}, {-1, 0, 1, 2}};
  const JointGraph clean = puppeteer_cleaned(tree);
  ASSERT_EQ(clean.joints.size(), 3u);
  EXPECT_EQ(clean.joints[1], tree.positions[1]);
  EXPECT_EQ(clean.bones, (Bones{{0, 1}, {1, 2}}));
}

TEST(PuppeteerCleaning, GroupsAroundTheirFirstJointOnly) {
  // 0.002 between neighbours: 1 takes in 2 but not 3, which is 0.004 away.
  const io::JointTree tree{{{0, 0, 0}, {0.1, 0, 0}, {0.102, 0, 0}, {0.104, 0, 0}}, {-1, 0, 1, 2}};
  const JointGraph clean = puppeteer_cleaned(tree);
  ASSERT_EQ(clean.joints.size(), 3u);
  EXPECT_EQ(clean.joints[2], tree.positions[3]);
}

TEST(PuppeteerCleaning, TheRootStandsForItsGroup) {
  const io::JointTree tree{{{0.001, 0, 0}, {0, 0, 0}, {0.1, 0, 0}}, {1, -1, 0}};
  const JointGraph clean = puppeteer_cleaned(tree);
  ASSERT_EQ(clean.joints.size(), 2u);
  EXPECT_EQ(clean.joints[0], tree.positions[1]);
  EXPECT_EQ(clean.bones, (Bones{{0, 1}}));
}

TEST(PuppeteerCleaning, DropsRepeatedBonesOfMergedBranches) {
  // Two tips in one place below the same joint.
  const io::JointTree tree{{{0, 0, 0}, {0.1, 0, 0}, {0.1, 0.001, 0}}, {-1, 0, 0}};
  const JointGraph clean = puppeteer_cleaned(tree);
  EXPECT_EQ(clean.joints.size(), 2u);
  EXPECT_EQ(clean.bones, (Bones{{0, 1}}));
}

TEST(PuppeteerCleaning, ConnectsComponentsNearestFirst) {
  // Three bones in a row with gaps of 0.01 (made one joint) and 0.05 (gets a bone); a lone joint is dropped.
  const io::JointTree tree{{{0, 0, 0}, {0.1, 0, 0}, {0.11, 0, 0}, {0.2, 0, 0}, {0.25, 0, 0}, {0.4, 0, 0}, {0, 0.4, 0}},
                           {-1, 0, -1, 2, -1, 4, -1}};
  const JointGraph clean = puppeteer_cleaned(tree);
  ASSERT_EQ(clean.joints.size(), 5u);
  EXPECT_EQ(clean.joints[1], tree.positions[1]);  // the lower index stays
  EXPECT_EQ(clean.joints[2], tree.positions[3]);
  EXPECT_EQ(clean.bones, (Bones{{0, 1}, {1, 2}, {3, 4}, {2, 3}}));
}

TEST(PuppeteerCleaning, ALoneRootIsConnected) {
  const io::JointTree tree{{{0, 0, 0}, {0.1, 0, 0}, {0.2, 0, 0}}, {-1, -1, 1}};
  const JointGraph clean = puppeteer_cleaned(tree);
  ASSERT_EQ(clean.joints.size(), 3u);
  EXPECT_EQ(clean.bones, (Bones{{1, 2}, {0, 1}}));
}

TEST(PuppeteerCleaning, WithoutBonesJointsStay) {
  const io::JointTree tree{{{0, 0, 0}, {0.001, 0, 0}, {0.2, 0, 0}}, {-1, -1, -1}};
  const JointGraph clean = puppeteer_cleaned(tree);
  EXPECT_EQ(clean.joints.size(), 2u);
  EXPECT_TRUE(clean.bones.empty());
}

TEST(PuppeteerCleaning, RefusesHugeForests) {
  io::JointTree forest;
  for (int i = 0; i < 4000; ++i) {
    forest.positions.push_back({0.01 * (i / 2), 0.1 * (i % 2), 0});
    forest.parents.push_back(i % 2 == 0 ? -1 : i - 1);
  }
  EXPECT_THROW(puppeteer_cleaned(forest), InputError);
  EXPECT_NO_THROW(puppeteer_cleaned(connected(forest)));
}

TEST(PuppeteerCleaning, IsWhatTheProtocolMeasures) {
  const io::JointTree truth{{{0, 0, 0}, {0.3, 0, 0}}, {-1, 0}};
  const io::JointTree doubled{{{0, 0, 0}, {0.3, 0, 0}, {0.3, 0.002, 0}}, {-1, 0, 0}};
  EXPECT_EQ(skeleton_chamfer(doubled, truth, SkeletonProtocol::kPuppeteer).j2j, 0.0);
  EXPECT_GT(skeleton_chamfer(doubled, truth, SkeletonProtocol::kRignet).j2j, 1e-4);
}

}  // namespace
}  // namespace anigen::eval
