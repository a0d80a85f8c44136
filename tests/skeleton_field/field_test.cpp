#include <gtest/gtest.h>
#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/core/parallel.h"
#include "anigen/core/random.h"
#include "anigen/skeleton_field/field.h"
#include "anigen/skeleton_field/loss.h"

namespace anigen::skeleton_field {

namespace {

/// 24 voxels on a line of x, voting alternately for joints at x = -0.25 and 0.25; the first is the parent of both.
SkeletonField two_joint_field() {
  SkeletonField field;
  const Tensor x = torch::linspace(-0.4, 0.4, 24).view({24, 1}), zeros = torch::zeros({24, 2});
  const Tensor side = torch::arange(24).remainder(2).to(torch::kFloat32).view({24, 1}) * 0.5 - 0.25;
  field.positions = torch::cat({x, zeros}, 1);
  field.joints = torch::cat({side, zeros}, 1);
  field.parents = torch::cat({torch::full({24, 1}, -0.25), zeros}, 1);
  field.conf_j = torch::full({24, 1}, 0.9);
  field.conf_p = torch::full({24, 1}, 0.8);
  return field;
}

TEST(SkeletonField, GroupsVotesByBothStrategies) {
  for (const std::string strategy : {"mean_shift", "threshold"}) {
    const SkeletonTensors skeleton = group_votes(two_joint_field(), strategy);
    ASSERT_EQ(skeleton.joints.sizes(), (std::vector<std::int64_t>{2, 3})) << strategy;
    EXPECT_EQ(skeleton.joints.scalar_type(), torch::kFloat32);
    EXPECT_NEAR(skeleton.joints[0][0].item<float>(), -0.25F, 1e-6F);
    EXPECT_NEAR(skeleton.joints[1][0].item<float>(), 0.25F, 1e-6F);
    EXPECT_TRUE(torch::equal(skeleton.parents, torch::tensor({-1, 0}, torch::kInt64))) << strategy;
  }
}

TEST(SkeletonField, GroupingTakesConfidenceFromTheField) {
  SkeletonField field = two_joint_field();
  field.conf_j = torch::full({24, 1}, 0.3);  // enough for the threshold strategy only
  EXPECT_EQ(group_votes(field, "threshold").joints.size(0), 2);
  const SkeletonTensors hopeless = group_votes(field, "mean_shift");
  EXPECT_TRUE(torch::equal(hopeless.joints, torch::zeros({1, 3})));
  EXPECT_TRUE(torch::equal(hopeless.parents, torch::zeros({1}, torch::kInt64)));
  field.conf_j = field.conf_p = Tensor();  // without confidence every vote counts
  EXPECT_EQ(group_votes(field, "mean_shift").joints.size(0), 2);
}

TEST(SkeletonField, GroupsNoVotesIntoNothing) {
  SkeletonField field;
  field.joints = field.parents = torch::zeros({0, 3});
  for (const std::string strategy : {"mean_shift", "threshold"}) {
    EXPECT_EQ(group_votes(field, strategy).joints.sizes(), (std::vector<std::int64_t>{0, 3}));
    EXPECT_EQ(group_votes(field, strategy).parents.numel(), 0);
  }
}

TEST(SkeletonField, GroupingRefusesBadFields) {
  const auto place = [](const SkeletonField& field) -> std::string {
    try {
      group_votes(field, "mean_shift");
    } catch (const InputError& error) {
      return error.place();
    }
    return "";
  };
  SkeletonField field = two_joint_field();
  field.joints[7][1] = std::numeric_limits<float>::quiet_NaN();
  EXPECT_EQ(place(field), "joints[7]");
  field = two_joint_field();
  field.parents = field.parents.slice(0, 1);
  EXPECT_EQ(place(field), "parents");
  field = two_joint_field();
  field.conf_p = field.conf_p.view({24});
  EXPECT_EQ(place(field), "conf_p");
  field = two_joint_field();
  field.joints = Tensor();
  EXPECT_EQ(place(field), "joints");
  EXPECT_THROW(group_votes(two_joint_field(), "dbscan"), InputError);
}

/// The sums written out voxel by voxel.
JointSkinFeatures plain_joint_features(const SkeletonField& field, const Tensor& joints) {
  const Tensor owner = (field.positions.unsqueeze(1) - joints.unsqueeze(0)).square().sum(2).argmin(1);
  std::vector<Tensor> means, variances;
  for (std::int64_t j = 0; j < joints.size(0); ++j) {
    const Tensor rows = (owner == j).nonzero().squeeze(1);
    const Tensor features = field.skin_features.index_select(0, rows);
    const Tensor weights = field.conf_skin.defined() ? torch::sigmoid(field.conf_skin.index_select(0, rows))
                                                     : torch::ones({rows.size(0), 1}, features.options());
    const Tensor total = weights.sum().clamp_min(1e-6);
    means.push_back((weights * features).sum(0) / total);
    variances.push_back((weights * features.square()).sum(0) / total - means.back().square());
  }
  return {torch::stack(means), torch::stack(variances).mean()};
}

SkeletonField random_field(std::int64_t voxels, std::int64_t channels) {
  SkeletonField field;
  field.positions = torch::rand({voxels, 3}, torch::kFloat64) - 0.5;
  field.skin_features = torch::randn({voxels, channels}, torch::kFloat64);
  field.conf_skin = torch::rand({voxels, 1}, torch::kFloat64);
  return field;
}

TEST(JointSkinFeatures, AreWeightedMeansOverTheVoxelsNearestToAJoint) {
  torch::manual_seed(1);
  for (const bool weighted : {true, false}) {
    SkeletonField field = random_field(200, 4);
    if (!weighted) field.conf_skin = Tensor();
    const Tensor joints = torch::rand({7, 3}, torch::kFloat64) - 0.5;
    const JointSkinFeatures found = joint_skin_features(field, joints), expected = plain_joint_features(field, joints);
    EXPECT_TRUE(torch::allclose(found.features, expected.features, 1e-10, 1e-12));
    EXPECT_TRUE(torch::allclose(found.variance, expected.variance, 1e-10, 1e-12));
  }
}

TEST(JointSkinFeatures, AJointWithoutVoxelsGetsZeros) {
  torch::manual_seed(2);
  const SkeletonField field = random_field(30, 3);
  const Tensor joints = torch::tensor({{0.0, 0.0, 0.0}, {50.0, 0.0, 0.0}}, torch::kFloat64);
  const JointSkinFeatures found = joint_skin_features(field, joints);
  EXPECT_TRUE(torch::equal(found.features[1], torch::zeros({3}, torch::kFloat64)));
  EXPECT_GT(found.variance.item<double>(), 0.0);
  const SkeletonField none = random_field(0, 3);
  EXPECT_TRUE(torch::equal(joint_skin_features(none, joints).features, torch::zeros({2, 3}, torch::kFloat64)));
  const JointSkinFeatures jointless = joint_skin_features(field, torch::zeros({0, 3}));
  EXPECT_EQ(jointless.features.sizes(), (std::vector<std::int64_t>{0, 3}));
  EXPECT_EQ(jointless.variance.item<double>(), 0.0);
}

// A joint halfway between voxels: of two equally near joints the first owns the voxel.
TEST(JointSkinFeatures, TiesGoToTheFirstJoint) {
  SkeletonField field;
  field.positions = torch::zeros({1, 3});
  field.skin_features = torch::ones({1, 2});
  const Tensor features = joint_skin_features(field, torch::tensor({{0.5, 0.0, 0.0}, {-0.5, 0.0, 0.0}})).features;
  EXPECT_TRUE(torch::equal(features, torch::tensor({{1.0F, 1.0F}, {0.0F, 0.0F}})));
}

TEST(JointSkinFeatures, GradientsAreThoseOfFiniteDifferences) {
  torch::manual_seed(3);
  const SkeletonField base = random_field(9, 2);
  const Tensor joints = torch::rand({3, 3}, torch::kFloat64) - 0.5, mix = torch::randn({3, 2}, torch::kFloat64);
  const auto value = [&](const Tensor& features, const Tensor& confidence) {
    SkeletonField field = base;
    field.skin_features = features;
    field.conf_skin = confidence;
    const JointSkinFeatures result = joint_skin_features(field, joints);
    return (result.features * mix).sum() + 3.0 * result.variance;
  };
  const Tensor features = base.skin_features.clone().requires_grad_();
  const Tensor confidence = base.conf_skin.clone().requires_grad_();
  value(features, confidence).backward();
  const torch::NoGradGuard no_grad;
  const double step = 1e-6;
  const auto check = [&](const Tensor& input, const auto& at) {
    for (std::int64_t i = 0; i < input.numel(); ++i) {
      const Tensor up = input.detach().clone(), down = input.detach().clone();
      up.view({-1})[i] += step;
      down.view({-1})[i] -= step;
      const double expected = (at(up) - at(down)).template item<double>() / (2.0 * step);
      // Central differences of a function of order one in double: about 1e-10 by rounding.
      EXPECT_NEAR(input.grad().view({-1})[i].item<double>(), expected, 1e-8) << i;
    }
  };
  check(features, [&](const Tensor& moved) { return value(moved, confidence); });
  check(confidence, [&](const Tensor& moved) { return value(features, moved); });
}

TEST(JointSkinFeatures, RefusesShapesThatDoNotFit) {
  torch::manual_seed(4);
  const Tensor joints = torch::zeros({2, 3});
  SkeletonField field = random_field(5, 3);
  field.conf_skin = field.conf_skin.slice(0, 1);
  EXPECT_THROW(joint_skin_features(field, joints), InputError);
  field = random_field(5, 3);
  field.skin_features = Tensor();
  EXPECT_THROW(joint_skin_features(field, joints), InputError);
  field = random_field(5, 3);
  EXPECT_THROW(joint_skin_features(field, torch::zeros({2, 2})), InputError);
  EXPECT_THROW(joint_skin_features(field, torch::full({1, 3}, std::numeric_limits<float>::infinity())), InputError);
}

}  // namespace

namespace {

std::vector<Eigen::Vector3d> draw_points(std::size_t count, std::uint64_t seed, int lattice) {
  Rng rng(seed, "points");
  std::vector<Eigen::Vector3d> points(count);
  for (Eigen::Vector3d& point : points) {
    for (double& x : point)
      x = lattice > 0 ? static_cast<double>(rng.index(static_cast<std::size_t>(lattice))) : rng.uniform(-0.5, 0.5);
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
  // A single joint has no second: never confident away from it.
  EXPECT_DOUBLE_EQ(joint_confidence(nearest_joints({{0.2, 0, 0}}, {{0, 0, 0}})[0]), 0.0);
}

/// A chain of a root, joint 0 at the origin, joint 1 one along x and joint 2 one further along y.
SkeletonTargets targets_on_a_corner(const Tensor& points) {
  const Tensor joints = torch::tensor({0.0F, 0.0F, 0.0F, 1.0F, 0.0F, 0.0F, 1.0F, 1.0F, 0.0F}).view({3, 3});
  return skeleton_targets(points, joints, torch::tensor({-1, 0, 1}, torch::kInt64));
}

TEST(JointField, PointsToTheNearestJointAndToItsParent) {
  const Tensor points = torch::tensor({0.25F, 0.0F, 0.5F, 0.75F, 0.25F, 0.0F, 1.0F, 0.75F, -0.5F}).view({3, 3});
  const SkeletonTargets targets = targets_on_a_corner(points);
  const auto field = [&](const Tensor& rows) { return targets.joints.index_select(0, rows) - points; };
  // The nearest are joints 0, 1 and 2. The root stands for its own parent.
  const Tensor to_joint = torch::tensor({-0.25F, 0.0F, -0.5F, 0.25F, -0.25F, 0.0F, 0.0F, 0.25F, 0.5F}).view({3, 3});
  const Tensor to_parent = torch::tensor({-0.25F, 0.0F, -0.5F, -0.75F, -0.25F, 0.0F, 0.0F, -0.75F, 0.5F}).view({3, 3});
  EXPECT_TRUE(torch::equal(field(targets.joint), to_joint)) << field(targets.joint);
  EXPECT_TRUE(torch::equal(field(targets.parent), to_parent)) << field(targets.parent);
  // d² to the two nearest of each: 5/16 and 13/16; 1/8 and 5/8, which joints 0 and 2 share; 5/16 and 13/16.
  const float side = 1.0F - 5.0F / 13.0F;
  EXPECT_TRUE(torch::allclose(targets.confidence, torch::tensor({side, 0.8F, side}).view({3, 1}), 1e-6, 1e-6))
      << targets.confidence;
}

TEST(JointField, EquallyNearJointsGiveTheLowestIndex) {
  // Half-way between joints 0 and 1, between 1 and 2, and at one distance from all three.
  const Tensor points = torch::tensor({0.5F, 0.0F, 0.0F, 1.0F, 0.5F, 0.0F, 0.5F, 0.5F, 0.25F}).view({3, 3});
  EXPECT_TRUE(torch::equal(targets_on_a_corner(points).joint, torch::tensor({0, 1, 0}, torch::kInt64)));
  // In any order along the axis, and where two joints lie in one place.
  const std::vector<Eigen::Vector3d> joints = {{0.5, 0, 0}, {-0.5, 0, 0}, {0.5, 0, 0}};
  const std::vector<NearestJoints> found =
      nearest_joints({{0, 0, 0}, {0.5, 0, 0}, {0.25, 0, 0}, {-0.25, 0, 0}}, joints);
  const std::vector<int> expected = {0, 0, 0, 1};
  for (std::size_t p = 0; p < expected.size(); ++p) EXPECT_EQ(found[p].joint, expected[p]) << p;
  EXPECT_EQ(joint_confidence(found[0]), joint_confidence({0, 0.25, 0.25}));
}

TEST(JointField, TargetConfidenceIsItsFormula) {
  const Tensor joints = torch::rand({7, 3}) - 0.5, points = torch::rand({200, 3}) - 0.5;
  const Tensor parents = torch::arange(-1, 6);
  for (const double least : {0.0, 0.1}) {
    SkeletonLossOptions options;
    options.least_confidence = least;
    const Tensor confidence = skeleton_targets(points, joints, parents, options).confidence;
    ASSERT_EQ(confidence.sizes(), torch::IntArrayRef({200, 1}));
    for (std::int64_t p = 0; p < 200; ++p) {
      std::vector<double> squared;
      for (std::int64_t j = 0; j < 7; ++j) {
        double sum = 0.0;
        for (std::int64_t axis = 0; axis < 3; ++axis) {
          const double step = joints[j][axis].item<double>() - points[p][axis].item<double>();
          sum += step * step;
        }
        squared.push_back(sum);
      }
      std::sort(squared.begin(), squared.end());
      const double kappa = 1.0 - std::min(1.0, squared[0] / (squared[1] + 1e-8));
      EXPECT_NEAR(confidence[p][0].item<double>(), std::max(least, kappa), 1e-7) << p;
    }
  }
}

TEST(JointField, RefusesBadInput) {
  const std::vector<Eigen::Vector3d> joints = {{0, 0, 0}, {0, 0, 1}}, points = {{0, 0, 0}};
  EXPECT_THROW(nearest_joints(points, {}), InputError);
  EXPECT_THROW(nearest_joints({{0, std::nan(""), 0}}, joints), InputError);
  EXPECT_THROW(nearest_joints({{0, 1e200, 0}}, joints), InputError);
  EXPECT_THROW(nearest_joints(points, {{INFINITY, 0, 0}}), InputError);
  EXPECT_TRUE(nearest_joints({}, joints).empty());
}

}  // namespace

}  // namespace anigen::skeleton_field
