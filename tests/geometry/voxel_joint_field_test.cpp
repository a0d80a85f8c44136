#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "anigen/core/error.h"
#include "anigen/core/parallel.h"
#include "anigen/core/random.h"
#include "anigen/geometry/joint_field.h"

namespace anigen::geometry {
namespace {

std::vector<Eigen::Vector3d> draw_points(std::size_t count, std::uint64_t seed, int lattice) {
  Rng rng(seed, "points");
  std::vector<Eigen::Vector3d> points(count);
  for (Eigen::Vector3d& point : points) {
    for (double& x : point) {
      x = lattice > 0 ? static_cast<double>(rng.index(static_cast<std::size_t>(lattice))) : rng.uniform(-0.5, 0.5);
    }
  }
  return points;
}

NearestJoints brute_force(const Eigen::Vector3d& point, const std::vector<Eigen::Vector3d>& joints) {
  NearestJoints best{-1, std::numeric_limits<double>::infinity(), std::numeric_limits<double>::infinity()};
  for (std::size_t j = 0; j < joints.size(); ++j) {
    const double squared = (joints[j] - point).squaredNorm();
    if (squared < best.first) {
      best = {static_cast<int>(j), squared, best.first};
    } else {
      best.second = std::min(best.second, squared);
    }
  }
  if (joints.size() == 1) best.second = 0.0;
  return best;
}

TEST(JointField, NearestJointsEqualBruteForceWithTies) {
  // On a small lattice most points have several equally near joints, and joints coincide.
  for (const int lattice : {0, 3, 6}) {
    for (const std::size_t count : {1u, 2u, 7u, 60u, 400u}) {
      const auto joints = draw_points(count, 1, lattice), points = draw_points(1000, 2, lattice);
      const std::vector<NearestJoints> found = nearest_joints(points, joints);
      for (std::size_t p = 0; p < points.size(); ++p) {
        const NearestJoints expected = brute_force(points[p], joints);
        ASSERT_EQ(found[p].joint, expected.joint) << lattice << " " << count << " " << p;
        ASSERT_EQ(found[p].first, expected.first);
        ASSERT_EQ(found[p].second, expected.second);
      }
    }
  }
}

TEST(JointField, ConfidenceFallsFromOneAtAJointToZeroBetweenTwo) {
  const std::vector<Eigen::Vector3d> joints = {{0, 0, 0}, {1, 0, 0}};
  const auto confidence = [&](double x) { return joint_confidence(nearest_joints({{x, 0, 0}}, joints)[0]); };
  EXPECT_DOUBLE_EQ(confidence(0.0), 1.0);
  EXPECT_NEAR(confidence(0.25), 1.0 - 1.0 / 9.0, 1e-7);
  EXPECT_NEAR(confidence(0.5), 0.0, 1e-7);
  EXPECT_DOUBLE_EQ(target_confidence(nearest_joints({{0.5, 0, 0}}, joints)[0]), 0.1);
  // A single joint has no second: never confident away from it.
  EXPECT_DOUBLE_EQ(joint_confidence(nearest_joints({{0.2, 0, 0}}, {{0, 0, 0}})[0]), 0.0);
}

TEST(JointField, PointsToTheNearestJointAndToItsParent) {
  const std::vector<Eigen::Vector3d> joints = {{0, 0, 0}, {0, 0, 1}, {0.5, 0, 1}};
  const std::vector<Eigen::Vector3d> points = {{0.1, 0, 0.9}, {0, 0.1, 0.1}};
  const auto field = joint_field(points, joints, {-1, 0, 1});
  EXPECT_EQ(field[0].joint, 1);
  EXPECT_EQ(field[0].parent, 0);
  EXPECT_LT((field[0].to_joint - Eigen::Vector3d(-0.1, 0, 0.1)).norm(), 1e-15);
  EXPECT_LT((field[0].to_parent - Eigen::Vector3d(-0.1, 0, -0.9)).norm(), 1e-15);
  EXPECT_EQ(field[1].parent, -1);
  EXPECT_EQ(field[1].to_parent, field[1].to_joint);  // the root is joint 0
  const auto published = joint_field(points, joints, {-1, 0, 1}, RootParent::kLastJoint);
  EXPECT_LT((published[1].to_parent - (joints[2] - points[1])).norm(), 1e-15);
}

TEST(JointField, VotesInvertTheField) {
  const auto joints = draw_points(20, 3, 0), points = draw_points(50, 4, 0);
  std::vector<int> parents(20);
  for (int j = 0; j < 20; ++j) parents[static_cast<std::size_t>(j)] = j == 0 ? -1 : (j - 1) / 2;
  const auto field = joint_field(points, joints, parents);
  for (std::size_t p = 0; p < points.size(); ++p) {
    const JointFieldPoint& at = field[p];
    const JointVote vote = joint_vote(points[p], {at.to_joint.x(), at.to_joint.y(), at.to_joint.z(), at.to_parent.x(),
                                                  at.to_parent.y(), at.to_parent.z(), 0.0, std::log(3.0)});
    EXPECT_LT((vote.joint - joints[static_cast<std::size_t>(at.joint)]).norm(), 1e-15);
    EXPECT_LT((vote.parent - joints[static_cast<std::size_t>(std::max(0, at.parent))]).norm(), 1e-15);
    EXPECT_DOUBLE_EQ(vote.joint_confidence, 0.5);
    EXPECT_NEAR(vote.parent_confidence, 0.75, 1e-15);
  }
}

TEST(JointField, RefusesBadInput) {
  const std::vector<Eigen::Vector3d> joints = {{0, 0, 0}, {0, 0, 1}}, points = {{0, 0, 0}};
  EXPECT_THROW(nearest_joints(points, {}), InputError);
  EXPECT_THROW(nearest_joints({{0, std::nan(""), 0}}, joints), InputError);
  EXPECT_THROW(nearest_joints({{0, 1e200, 0}}, joints), InputError);
  EXPECT_THROW(nearest_joints(points, {{INFINITY, 0, 0}}), InputError);
  EXPECT_THROW(joint_field(points, joints, {-1}), InputError);
  EXPECT_THROW(joint_field(points, joints, {-1, 2}), InputError);
  EXPECT_THROW(joint_field(points, joints, {-1, -2}), InputError);
  EXPECT_TRUE(nearest_joints({}, joints).empty());
}

}  // namespace
}  // namespace anigen::geometry
