#include "tests/eval/study.h"

#include <gtest/gtest.h>

#include "anigen/core/error.h"
#include "tests/eval/rigged_walker.h"

namespace anigen::eval {
namespace {

double total(const io::RiggedShape& shape) {
  double sum = 0;
  for (const Influence& influence : shape.skin.influences) sum += influence.weight;
  return sum;
}

TEST(Perturbations, LeaveASoundShape) {
  const io::RiggedShape shape = test::rigged_walker(4);
  for (const Perturbation& mistake : perturbations()) {
    const io::RiggedShape changed = mistake.apply(shape);
    SCOPED_TRACE(mistake.name);
    EXPECT_NO_THROW(check(changed.joints, "changed"));
    EXPECT_EQ(changed.skin.rows(), shape.mesh.vertices.size());
    EXPECT_NEAR(total(changed), static_cast<double>(shape.mesh.vertices.size()), 1e-3);
    for (const Influence& influence : changed.skin.influences)
      EXPECT_LT(influence.joint, static_cast<int>(changed.joints.size()));
  }
}

TEST(Perturbations, DoWhatTheySay) {
  const io::RiggedShape shape = test::rigged_walker(4);
  const io::RiggedShape inserted = with_inserted_joint(shape);
  EXPECT_EQ(inserted.joints.size(), 8u);
  EXPECT_EQ(roots(inserted.joints).size(), 1u);

  const io::RiggedShape duplicated = with_duplicated_branch(shape);
  EXPECT_EQ(duplicated.joints.size(), 9u);  // the leg of two joints is the largest branch
  EXPECT_EQ(duplicated.joints.parents[8], 7);
  EXPECT_EQ(duplicated.joints.parents[7], 0);

  EXPECT_NE(with_reparented_subtree(shape).joints.parents[5], 0);
  EXPECT_EQ(with_dropped_joints(shape).joints.size(), 6u);
  EXPECT_EQ(with_dropped_joints(shape, 1, 1.0).joints.size(), 1u);
}

TEST(Perturbations, RefuseSkeletonsThatAreTooSmall) {
  io::RiggedShape shape = test::rigged_walker(4);
  shape.joints = {{{0, 0, 0}}, {-1}};
  shape.skin = {};
  EXPECT_THROW(with_inserted_joint(shape), InputError);
  EXPECT_THROW(with_duplicated_branch(shape), InputError);
  EXPECT_THROW(with_reparented_subtree(shape), InputError);
  EXPECT_THROW(with_dropped_joints(shape), InputError);
  EXPECT_THROW(with_blurred_weights(shape), InputError);
}

// The claims of the paper, section 4.1.3, on one rig: the tables of docs/results.md have them on real ones.
TEST(MetricStudy, WhatThePaperSaysAboutTheMetricsHolds) {
  const anigen::Table table = sensitivity(evaluate_mistakes({test::rigged_walker(4)}));
  std::size_t claims = 0;
  for (const auto& row : table.rows) {
    if (row[0] != "joint inserted mid-bone" && row[0] != "branch duplicated 0.1 % away") continue;
    if (row[2] == "open") continue;
    EXPECT_EQ(row[6], "1 of 1") << row[0] << ", " << row[1] << ": " << row[3];
    ++claims;
  }
  EXPECT_GE(claims, 10u);
}

TEST(MetricStudy, EveryBrokenPredictionHasAnOutcome) {
  const anigen::Table table = degenerate_inputs(test::rigged_walker(4));
  EXPECT_EQ(table.rows.size(), 9u);
  for (const auto& row : table.rows) EXPECT_FALSE(row[1].empty()) << row[0];
}

}  // namespace
}  // namespace anigen::eval
