#include "anigen/eval/merged_joints.h"

#include <gtest/gtest.h>

#include "anigen/core/numeric.h"
#include "anigen/eval/pair.h"
#include "tests/eval/rigged_walker.h"

namespace anigen::eval {
namespace {

/// walker() whose joint 5 got a helper beside it that shares its weights and takes over its child.
io::RiggedShape walker_with_helper(double off) {
  io::RiggedShape shape = test::rigged_walker();
  const auto helper = static_cast<int>(shape.joints.size());
  shape.joints.positions.push_back(shape.joints.positions[5] + Eigen::Vector3d(off, 0, 0));
  shape.joints.parents.push_back(5);
  shape.joints.parents[6] = helper;  // a child that is listed before its parent
  SkinWeights skin;
  for (std::size_t v = 0; v < shape.skin.rows(); ++v) {
    std::vector<Influence> row(shape.skin.row(v), shape.skin.row(v) + shape.skin.row_size(v));
    for (Influence& influence : row) {
      if (influence.joint == 5 && v % 2 == 0) influence.joint = helper;
    }
    skin.append_row(std::move(row));
  }
  shape.skin = std::move(skin);
  return shape;
}

TEST(MergedJoints, AHelperGoesIntoItsJointWithChildrenAndWeights) {
  const io::RiggedShape plain = test::rigged_walker();
  io::RiggedShape shape = walker_with_helper(0.004);
  EXPECT_EQ(merge_joints(shape, 0.003), 0u);
  ASSERT_EQ(shape.joints.size(), plain.joints.size() + 1);
  ASSERT_EQ(merge_joints(shape, 0.005), 1u);
  check(shape.joints, "merged");
  EXPECT_EQ(tree_signature(shape.joints.parents), tree_signature(plain.joints.parents));
  ASSERT_EQ(shape.skin.rows(), plain.skin.rows());
  EXPECT_TRUE(shape.has_skin());
  for (const std::size_t v : {0, 1, 100, 101}) {
    const Eigen::Vector3d truth = plain.joints.positions[at(plain.skin.row(v)->joint)];
    EXPECT_EQ(shape.joints.positions[at(shape.skin.row(v)->joint)], truth) << v;
  }
}

TEST(MergedJoints, AMergedJointAttractsNoOthers) {
  io::RiggedShape shape;
  shape.joints.positions = {{0, 0, 0}, {0, 0, 0.6}, {0, 0, 1.2}, {0, 0, 1.8}};
  shape.joints.parents = {-1, 0, 1, 2};
  EXPECT_EQ(merge_joints(shape, 1.0), 2u);
  ASSERT_EQ(shape.joints.size(), 2u);
  EXPECT_EQ(shape.joints.positions[1].z(), 1.2);
  EXPECT_EQ(shape.joints.parents, (std::vector<int>{-1, 0}));
}

TEST(MergedJoints, APairDiffersByAHelperOnlyWhereHelpersCount) {
  PairSettings settings;
  settings.groups = {"skeleton", "skin"};
  settings.poses = 2;
  settings.surface_samples = 2000;
  const io::RiggedShape plain = test::rigged_walker(), helped = walker_with_helper(0.002);
  const PairResult apart = evaluate_pair(plain, helped, settings);
  EXPECT_EQ(apart.value("joint_count_error"), 1.0);
  EXPECT_GT(apart.value("skin_l1"), 0.1);
  settings.merge_joints = 0.01;
  const PairResult merged = evaluate_pair(plain, helped, settings);
  EXPECT_EQ(merged.value("joint_count_error"), 0.0);
  EXPECT_LT(merged.value("skin_l1"), 1e-5);
  EXPECT_LT(merged.value("j2j"), 1e-6);
  ASSERT_EQ(merged.notes.size(), 1u);
  EXPECT_NE(merged.notes[0].find("1 joints merged"), std::string::npos) << merged.notes[0];
  settings.merge_joints = 1.0;
  EXPECT_THROW(check(settings), InputError);
}

}  // namespace
}  // namespace anigen::eval
