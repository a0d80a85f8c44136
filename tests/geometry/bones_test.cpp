#include <gtest/gtest.h>
#include <algorithm>
#include <cmath>

#include "anigen/core/error.h"
#include "anigen/core/random.h"
#include "anigen/geometry/bones.h"

namespace anigen::geometry {

namespace {

TEST(Segment, MatchesDenseSampling) {
  Rng rng(1, "segments");
  const auto draw = [&] { return Eigen::Vector3d(rng.uniform(-1, 1), rng.uniform(-1, 1), rng.uniform(-1, 1)); };
  constexpr int kSteps = 2000;
  for (int i = 0; i < 200; ++i) {
    const Eigen::Vector3d p = draw(), a = draw(), b = draw();
    double sampled = 1e9;
    for (int s = 0; s <= kSteps; ++s) sampled = std::min(sampled, (a + double(s) / kSteps * (b - a) - p).norm());
    EXPECT_LE(distance_to_segment(p, a, b), sampled + 1e-12);
    EXPECT_NEAR(distance_to_segment(p, a, b), sampled, 2.0 / kSteps);
  }
  EXPECT_NEAR(distance_to_segment({3, 4, 0}, {0, 0, 0}, {0, 0, 0}), 5.0, 1e-15);
}

TEST(Bones, OnePerJointWithAParent) {
  const std::vector<Bone> bones = bones_of({{0, 0, 0}, {0, 0, 1}, {1, 0, 1}}, {-1, 0, 1});
  ASSERT_EQ(bones.size(), 2u);
  EXPECT_EQ(bones[1].parent, 1);
  EXPECT_EQ(bones[1].joint, 2);
  EXPECT_TRUE(bones[1].head.isApprox(Eigen::Vector3d(0, 0, 1)));
  EXPECT_TRUE(bones[1].tail.isApprox(Eigen::Vector3d(1, 0, 1)));
}

TEST(Bones, ASkeletonWithoutBonesGivesItsJoints) {
  const std::vector<Bone> bones = bones_of({{1, 2, 3}}, {-1});
  ASSERT_EQ(bones.size(), 1u);
  EXPECT_TRUE(bones[0].head.isApprox(bones[0].tail));
  EXPECT_TRUE(bones_of({}, {}).empty());
}

TEST(Bones, RefuseBadInput) {
  EXPECT_THROW(bones_of({{0, 0, 0}}, {}), InputError);
  EXPECT_THROW(bones_of({{0, 0, 0}}, {1}), InputError);
  EXPECT_THROW(bones_of({{0, 0, 0}, {0, NAN, 0}}, {-1, 0}), InputError);
}

}  // namespace

namespace {

// A chain along x: joints at 0, 1 and 2. The tip's own bone goes on to 2.5.
const std::vector<Eigen::Vector3f> kChain = {{0, 0, 0}, {1, 0, 0}, {2, 0, 0}};
const std::vector<int> kParents = {-1, 0, 1};

TEST(BoneSegments, BelongToTheJointThatMovesThem) {
  const auto segments = bone_segments(kChain, kParents);
  ASSERT_EQ(segments.size(), 3u);
  EXPECT_EQ(segments[0][0].end, Eigen::Vector3f(1, 0, 0));
  EXPECT_EQ(segments[2][0].start, Eigen::Vector3f(2, 0, 0));
  EXPECT_EQ(segments[2][0].end, Eigen::Vector3f(2.5f, 0, 0));
  EXPECT_NEAR(distance({0.5f, 2, 0}, segments[0]), 2.0f, 1e-6f);
  EXPECT_NEAR(distance({4, 0, 0}, segments[0]), 3.0f, 1e-6f);
  const auto lone = bone_segments({{1, 2, 3}}, {-1});
  EXPECT_NEAR(distance({1, 2, 5}, lone[0]), 2.0f, 1e-6f);
}

TEST(BoneSegments, NearestMovingJoints) {
  const auto segments = bone_segments(kChain, kParents);
  const std::vector<std::size_t> joints =
      nearest_moving_joints({{0.3f, 0.1f, 0}, {1.6f, 0, -0.2f}, {9, 0, 0}, {1, 5, 0}}, segments);
  EXPECT_EQ(joints, (std::vector<std::size_t>{0, 1, 2, 0}));  // the last is as near to joint 1's bone
  EXPECT_THROW(nearest_moving_joints({{0, 0, 0}}, {}), InputError);
}

}  // namespace

}  // namespace anigen::geometry
