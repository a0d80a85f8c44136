#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "anigen/core/error.h"
#include "anigen/core/random.h"
#include "anigen/metrics/matching.h"
#include "anigen/metrics/skin_metrics.h"

namespace anigen::metrics {
namespace {

using Eigen::Vector3d;
using Points = std::vector<Vector3d>;

double total(const Eigen::MatrixXd& cost, const std::vector<int>& columns) {
  double sum = 0;
  for (std::size_t r = 0; r < columns.size(); ++r) {
    if (columns[r] >= 0) sum += cost(static_cast<Eigen::Index>(r), columns[r]);
  }
  return sum;
}

/// Over all injections of the smaller side into the larger one.
double best_by_enumeration(const Eigen::MatrixXd& cost) {
  if (cost.rows() > cost.cols()) return best_by_enumeration(cost.transpose());
  std::vector<int> columns(static_cast<std::size_t>(cost.cols()));
  std::iota(columns.begin(), columns.end(), 0);
  double best = std::numeric_limits<double>::infinity();
  do {
    double sum = 0;
    for (Eigen::Index r = 0; r < cost.rows(); ++r) sum += cost(r, columns[static_cast<std::size_t>(r)]);
    best = std::min(best, sum);
  } while (std::next_permutation(columns.begin(), columns.end()));
  return best;
}

TEST(Assignment, IsAsCheapAsTheBestOfAllPermutations) {
  for (std::uint64_t trial = 0; trial < 300; ++trial) {
    Rng rng(trial, "assignment_test");
    Eigen::MatrixXd cost(1 + static_cast<Eigen::Index>(rng.index(6)), 1 + static_cast<Eigen::Index>(rng.index(6)));
    // Every second trial with few distinct values, for ties.
    for (double& c : cost.reshaped()) c = trial % 2 == 0 ? rng.uniform(-1.0, 1.0) : static_cast<double>(rng.index(3));
    const std::vector<int> columns = assign(cost);
    std::vector<int> used;
    for (const int c : columns) {
      if (c >= 0) used.push_back(c);
    }
    EXPECT_EQ(static_cast<Eigen::Index>(used.size()), std::min(cost.rows(), cost.cols()));
    std::sort(used.begin(), used.end());
    EXPECT_EQ(std::adjacent_find(used.begin(), used.end()), used.end()) << "a column twice";
    EXPECT_NEAR(total(cost, columns), best_by_enumeration(cost), 1e-12) << "trial " << trial;
  }
}

TEST(Assignment, RejectsWhatItCannotCompare) {
  EXPECT_THROW(assign(Eigen::MatrixXd::Constant(2, 2, std::nan(""))), InputError);
  EXPECT_THROW(assign(Eigen::MatrixXd::Constant(2, 2, std::numeric_limits<double>::infinity())), InputError);
  EXPECT_TRUE(assign(Eigen::MatrixXd(0, 3)).empty());
  EXPECT_EQ(assign(Eigen::MatrixXd(2, 0)), (std::vector<int>{-1, -1}));
}

TEST(JointMatching, CountsPairsBelowTheTrueJointsTolerance) {
  const Points truth = {{0, 0, 0}, {1, 0, 0}}, predicted = {{0.9, 0, 0}, {0, 0.05, 0}, {5, 0, 0}};
  const JointMatch loose = match_joints(predicted, truth, {0.06, 0.2});
  EXPECT_EQ(loose.truth_of, (std::vector<int>{1, 0, -1}));
  EXPECT_DOUBLE_EQ(loose.iou, 2.0 * 2 / 5);
  EXPECT_DOUBLE_EQ(loose.precision, 2.0 / 3);
  EXPECT_DOUBLE_EQ(loose.recall, 1.0);
  // Strictly below; the tolerance is that of the true joint.
  const JointMatch strict = match_joints(predicted, truth, {0.05, 0.2});
  EXPECT_EQ(strict.truth_of, (std::vector<int>{1, -1, -1}));
  EXPECT_EQ(match_joints(predicted, truth).matched, 0u);  // 0.05 for all
}

TEST(JointMatching, UsesTheAssignmentNotTheNearestJoint) {
  // Both predictions are nearest to truth 0; the least total sends the second one to truth 1, out of tolerance.
  const Points truth = {{0, 0, 0}, {1, 0, 0}}, predicted = {{0.01, 0, 0}, {0.02, 0, 0}};
  EXPECT_EQ(match_joints(predicted, truth).truth_of, (std::vector<int>{0, -1}));
}

TEST(JointMatching, RejectsBadInput) {
  EXPECT_THROW(match_joints({}, {{0, 0, 0}}), InputError);
  EXPECT_THROW(match_joints({{0, 0, 0}}, {}), InputError);
  EXPECT_THROW(match_joints({{0, 0, 0}}, {{0, 0, 0}}, std::vector<double>{}), InputError);
  EXPECT_THROW(match_joints({{std::nan(""), 0, 0}}, {{0, 0, 0}}), InputError);
  EXPECT_THROW(match_joints(Points(3000, Vector3d::Zero()), Points(3000, Vector3d::Zero())), InputError);
}

/// A box of half widths (x, y, z).
geometry::RayCaster box(float x, float y, float z) {
  std::vector<Eigen::Vector3f> vertices;
  for (int i = 0; i < 8; ++i) vertices.push_back({i & 1 ? x : -x, i & 2 ? y : -y, i & 4 ? z : -z});
  return {vertices,
          {{0, 1, 3},
           {0, 3, 2},
           {4, 5, 7},
           {4, 7, 6},
           {0, 1, 5},
           {0, 5, 4},
           {2, 3, 7},
           {2, 7, 6},
           {0, 2, 6},
           {0, 6, 4},
           {1, 3, 7},
           {1, 7, 5}}};
}

TEST(JointTolerance, IsTheMeanDistanceToTheSurfaceAcrossTheBones) {
  // A bone along x inside a long square bar: rays meet the four sides at 0.1 / max(|cos|, |sin|).
  const JointTree tree{{{-0.3, 0, 0}, {0.3, 0, 0}}, {-1, 0}};
  const std::vector<double> tolerance = joint_tolerances(tree, box(0.5f, 0.1f, 0.1f));
  ASSERT_EQ(tolerance.size(), 2u);
  // The mean over all angles is 0.1 · (4/π) ln(1 + √2); 14 of them come within 2 %, whatever angle they start at.
  const double mean = 0.1 * 4.0 / 3.14159265358979 * std::log(1.0 + std::sqrt(2.0));
  EXPECT_NEAR(tolerance[0], mean, 0.02 * mean);
  EXPECT_NEAR(tolerance[1], mean, 0.02 * mean);
}

TEST(JointTolerance, AveragesTheBonesOfAJointAndFallsBackOutside) {
  // The middle joint has one bone along x and one along z.
  const JointTree bent{{{-0.3, 0, 0}, {0, 0, 0}, {0, 0, 0.05}}, {-1, 0, 1}};
  const auto caster = box(0.5f, 0.1f, 0.1f);
  const std::vector<double> tolerance = joint_tolerances(bent, caster);
  const double across_x = joint_tolerances(JointTree{{{-0.3, 0, 0}, {0, 0, 0}}, {-1, 0}}, caster)[1];
  const double across_z = joint_tolerances(JointTree{{{0, 0, 0}, {0, 0, 0.05}}, {-1, 0}}, caster)[0];
  EXPECT_GT(across_z, 1.5 * across_x);
  EXPECT_NEAR(tolerance[1], 0.5 * (across_x + across_z), 1e-9);

  // Rays around a bone along x, far beyond the end of the bar, meet nothing.
  const JointTree outside{{{2, 0, 0}, {3, 0, 0}}, {-1, 0}};
  EXPECT_EQ(joint_tolerances(outside, caster, 0.07), (std::vector<double>{0.07, 0.07}));
}

TEST(JointTolerance, OfALoneJointLooksAroundAllAxes) {
  const auto caster = box(0.1f, 0.1f, 0.1f);
  const double lone = joint_tolerances(JointTree{{{0, 0, 0}}, {-1}}, caster)[0];
  EXPECT_GT(lone, 0.1);
  EXPECT_LT(lone, 0.1 * std::sqrt(2.0));
  // Two joints in one place have a bone without direction: the same.
  EXPECT_NEAR(joint_tolerances(JointTree{{{0, 0, 0}, {0, 0, 0}}, {-1, 0}}, caster)[1], lone, 1e-12);
}

TEST(Connectivity, CountsBonesWhoseEndsMatchATrueBone) {
  const JointTree truth{{{0, 0, 0}, {1, 0, 0}, {2, 0, 0}, {1, 1, 0}}, {-1, 0, 1, 1}};
  // Joint 3 hangs on 0 instead of 1.
  const JointTree predicted{truth.positions, {-1, 0, 1, 0}};
  const ConnectivityScore score = connectivity(predicted, truth, {0, 1, 2, 3});
  EXPECT_EQ(score.right, 2u);
  EXPECT_DOUBLE_EQ(score.precision, 2.0 / 3);
  EXPECT_DOUBLE_EQ(score.recall, 2.0 / 3);
  // An unmatched joint takes its bones out of the count.
  EXPECT_EQ(connectivity(truth, truth, {0, -1, 2, 3}).right, 0u);
  EXPECT_EQ(connectivity(truth, truth, {0, 1, -1, 3}).right, 2u);
}

TEST(Connectivity, DoesNotDependOnRootOrNumbering) {
  const JointTree truth{{{0, 0, 0}, {1, 0, 0}, {2, 0, 0}}, {-1, 0, 1}};
  const JointTree rerooted{{{2, 0, 0}, {1, 0, 0}, {0, 0, 0}}, {-1, 0, 1}};
  const ConnectivityScore score =
      connectivity(rerooted, truth, match_joints(rerooted.positions, truth.positions).truth_of);
  EXPECT_EQ(score.precision, 1.0);
  EXPECT_EQ(score.recall, 1.0);
}

TEST(Connectivity, SeesAJointInsertedInABone) {
  const JointTree truth{{{0, 0, 0}, {1, 0, 0}, {2, 0, 0}}, {-1, 0, 1}};
  const JointTree inserted{{{0, 0, 0}, {1, 0, 0}, {2, 0, 0}, {0.5, 0, 0}}, {-1, 3, 1, 0}};
  const ConnectivityScore score = connectivity(inserted, truth, {0, 1, 2, -1});
  EXPECT_DOUBLE_EQ(score.precision, 1.0 / 3);
  EXPECT_DOUBLE_EQ(score.recall, 1.0 / 2);
  EXPECT_EQ(joint_count_error(inserted, truth), 1u);
  EXPECT_EQ(joint_count_error(truth, inserted), 1u);
}

TEST(Connectivity, IsDefinedWithoutBones) {
  const JointTree single{{{0, 0, 0}}, {-1}}, pair{{{0, 0, 0}, {1, 0, 0}}, {-1, 0}};
  EXPECT_EQ(connectivity(single, single, {0}).precision, 1.0);
  EXPECT_EQ(connectivity(single, pair, {0}).precision, 0.0);
  EXPECT_EQ(connectivity(single, pair, {0}).recall, 0.0);
  EXPECT_EQ(connectivity(pair, single, {0, -1}).recall, 0.0);
  EXPECT_THROW(connectivity(single, pair, {}), InputError);
  EXPECT_THROW(connectivity(single, pair, {2}), InputError);
}

TEST(JointMatching, JointsInOnePlaceAreToldApartByTheTree) {
  // Two joints lie on joint 1, and the copy lists them in another order.
  const JointTree truth{{{0, 0, 0}, {1, 0, 0}, {1, 0, 0}, {1, 0, 0}, {2, 0, 0}}, {-1, 0, 1, 2, 3}};
  const JointTree copy{{{2, 0, 0}, {1, 0, 0}, {1, 0, 0}, {1, 0, 0}, {0, 0, 0}}, {1, 3, 4, 2, -1}};
  const JointMatch match = match_joints(copy, truth, std::vector<double>(5, 0.05));
  EXPECT_EQ(match.truth_of, (std::vector<int>{4, 3, 1, 2, 0}));
  EXPECT_EQ(connectivity(copy, truth, match.truth_of).recall, 1.0);
  // The plan hands every joint's weights to the same joints.
  EXPECT_EQ(strongest_match(matching_plan(copy, truth)), (std::vector<int>{4, 3, 1, 2, 0}));
}

}  // namespace
}  // namespace anigen::metrics
