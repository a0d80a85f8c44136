#include "anigen/data/augment.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

namespace anigen::data {
namespace {

// A small arm: 0 ← 1 ← 2, and 3 on 0.
const std::vector<Eigen::Vector3f> kJoints{{0, 0, 0}, {0.3f, 0, 0}, {0.3f, 0.2f, 0.1f}, {0, 0, -0.4f}};
const std::vector<int> kParents{-1, 0, 1, 0};
const std::vector<int> kOrder{0, 1, 2, 3};

float bone(const RigDraw& rig, std::size_t j) {
  return (rig.joints[j] - rig.joints[static_cast<std::size_t>(rig.parents[j])]).norm();
}

TEST(Augment, OffMeansUnchangedAndNoRandomNumbers) {
  Rng rng(1, "t");
  const RigDraw rig = augment(kJoints, kParents, kOrder, {true, true, true, true}, {}, rng);
  EXPECT_EQ(rig.joints, kJoints);
  EXPECT_EQ(rig.parents, kParents);
  EXPECT_EQ(rig.joint_of, (std::vector<int>{0, 1, 2, 3}));
  EXPECT_EQ(rng.state()[1], 0u);
}

TEST(Augment, RotationsKeepDistancesAndAboutZKeepsHeight) {
  for (const auto kind : {Augmentations::Rotation::kAboutZ, Augmentations::Rotation::kAny}) {
    Rng rng(2, "t");
    RigDraw rig = unchanged(kJoints, kParents);
    rotate(rig, kind, rng);
    float moved = 0, tilted = 0;
    for (std::size_t j = 0; j < 4; ++j) {
      EXPECT_NEAR(rig.joints[j].norm(), kJoints[j].norm(), 1e-6f);
      moved = std::max(moved, (rig.joints[j] - kJoints[j]).norm());
      tilted = std::max(tilted, std::abs(rig.joints[j].z() - kJoints[j].z()));
    }
    EXPECT_GT(moved, 0.01f);
    if (kind == Augmentations::Rotation::kAboutZ)
      EXPECT_LT(tilted, 1e-6f);
    else
      EXPECT_GT(tilted, 0.01f);
  }
}

// The mean of many uniform rotations of a vector is zero: 3 standard errors of 4000 draws on the unit sphere.
TEST(Augment, AnyRotationIsUniform) {
  Rng rng(3, "t");
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  for (int i = 0; i < 4000; ++i) {
    RigDraw rig = unchanged({{0, 0, 1}}, {-1});
    rotate(rig, Augmentations::Rotation::kAny, rng);
    sum += rig.joints[0].cast<double>();
  }
  EXPECT_LT((sum / 4000).norm(), 3.0 / std::sqrt(4000.0));
}

TEST(Augment, ScaleIsPerAxisAndBounded) {
  Rng rng(4, "t");
  RigDraw rig = unchanged({{1, 1, 1}, {2, 2, 2}}, {-1, 0});
  scale_axes(rig, 0.3, rng);
  for (int axis = 0; axis < 3; ++axis) {
    EXPECT_LE(std::abs(std::log(rig.joints[0][axis])), 0.3f);
    EXPECT_FLOAT_EQ(rig.joints[1][axis], 2 * rig.joints[0][axis]);
  }
  EXPECT_NE(rig.joints[0].x(), rig.joints[0].y());
}

TEST(Augment, PosingKeepsBoneLengthsAndTheRoot) {
  Rng rng(5, "t");
  RigDraw rig = unchanged(kJoints, kParents);
  pose(rig, kOrder, 40.0, rng);
  EXPECT_EQ(rig.joints[0], kJoints[0]);
  for (const std::size_t j : {1u, 2u, 3u}) EXPECT_NEAR(bone(rig, j), bone(unchanged(kJoints, kParents), j), 1e-6f);
  EXPECT_GT((rig.joints[2] - kJoints[2]).norm(), 0.01f);
}

TEST(Augment, JitterIsRelativeToTheBone) {
  // Over many draws the root-mean-square offset is σ·length·√3; 5 % is over four standard errors of 3 · 2000 normals.
  Rng rng(6, "t");
  double square = 0;
  for (int i = 0; i < 2000; ++i) {
    RigDraw rig = unchanged(kJoints, kParents);
    jitter_joints(rig, 0.1, rng);
    square += (rig.joints[3] - kJoints[3]).squaredNorm();
  }
  EXPECT_NEAR(std::sqrt(square / 2000) / (0.1 * 0.4 * std::sqrt(3.0)), 1.0, 0.05);
  RigDraw lone = unchanged({{1, 2, 3}}, {-1});
  jitter_joints(lone, 0.5, rng);
  EXPECT_EQ(lone.joints[0], Eigen::Vector3f(1, 2, 3));
}

TEST(Augment, MergingSendsWeightToTheNearestAncestorThatStays) {
  bool merged_something = false;
  for (std::uint64_t seed = 0; seed < 50; ++seed) {
    Rng rng(seed, "t");
    RigDraw rig = unchanged(kJoints, kParents);
    merge_joints(rig, 0.7, rng);
    ASSERT_GE(rig.joints.size(), 2u) << "0.7 of three joints is two";
    ASSERT_EQ(rig.joints.size(), rig.parents.size());
    EXPECT_EQ(rig.joint_of[0], 0);
    merged_something = merged_something || rig.joints.size() < 4;
    for (std::size_t source = 0; source < 4; ++source) {
      int expected = static_cast<int>(source);
      while (std::find(rig.joints.begin(), rig.joints.end(), kJoints[static_cast<std::size_t>(expected)]) ==
             rig.joints.end()) {
        expected = kParents[static_cast<std::size_t>(expected)];
      }
      EXPECT_EQ(rig.joints[static_cast<std::size_t>(rig.joint_of[source])],
                kJoints[static_cast<std::size_t>(expected)]);
    }
    for (std::size_t j = 1; j < rig.parents.size(); ++j) EXPECT_LT(rig.parents[j], static_cast<int>(j));
  }
  EXPECT_TRUE(merged_something);
}

TEST(Augment, OnlySubtreesWithoutWeightAreDropped) {
  RigDraw rig = unchanged(kJoints, kParents);
  drop_unweighted(rig, {false, false, true, false});
  EXPECT_EQ(rig.joints, (std::vector<Eigen::Vector3f>{kJoints[0], kJoints[1], kJoints[2]}))
      << "1 carries no weight but 2 below it does";
  EXPECT_EQ(rig.parents, (std::vector<int>{-1, 0, 1}));
  EXPECT_EQ(rig.joint_of, (std::vector<int>{0, 1, 2, 0}));
}

TEST(Augment, SharpenKeepsZerosAndTheSum) {
  std::vector<float> row{0.6f, 0.0f, 0.3f, 0.1f};
  sharpen(row.data(), row.size(), 2.0f);
  EXPECT_NEAR(row[0], 0.36f / 0.46f, 1e-6f);
  EXPECT_EQ(row[1], 0.0f);
  EXPECT_NEAR(row[0] + row[2] + row[3], 1.0f, 1e-6f);
}

}  // namespace
}  // namespace anigen::data
