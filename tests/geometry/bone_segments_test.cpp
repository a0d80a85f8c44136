#include "anigen/geometry/bone_segments.h"

#include <gtest/gtest.h>

#include "anigen/core/error.h"

namespace anigen::geometry {
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
