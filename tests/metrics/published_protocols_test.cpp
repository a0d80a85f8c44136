#include <gtest/gtest.h>
#include <cmath>

#include "anigen/core/error.h"
#include "anigen/core/random.h"
#include "anigen/metrics/chamfer.h"
#include "anigen/metrics/published_protocols.h"

namespace anigen::metrics {

namespace {

using Eigen::MatrixXd;
using Eigen::Vector3d;
using Points = std::vector<Vector3d>;

AnymateOccupancy everywhere() {
  std::vector<std::array<int, 3>> cells;
  for (int x = 0; x < 64; ++x) {
    for (int y = 0; y < 64; ++y) {
      for (int z = 0; z < 64; ++z) cells.push_back({x, y, z});
    }
  }
  return AnymateOccupancy(cells);
}

/// One-hot rows; a root points at itself.
MatrixXd one_hot(const std::vector<int>& parents) {
  const auto n = static_cast<Eigen::Index>(parents.size());
  MatrixXd result = MatrixXd::Zero(n, n);
  for (Eigen::Index i = 0; i < n; ++i) {
    const int parent = parents[static_cast<std::size_t>(i)];
    result(i, parent < 0 ? i : parent) = 1.0;
  }
  return result;
}

TEST(AnymateJoint, AgreesWithHandComputedNumbers) {
  const Points truth = {{0, 0, 0}, {1, 0, 0}}, predicted = {{0.05, 0, 0}, {0, 0.3, 0}};
  const AnymateJointScore score = anymate_joint(predicted, truth);
  EXPECT_TRUE(score.not_computed.empty());
  EXPECT_NEAR(score.cd, 0.5 * (0.5 * (0.05 + 0.3) + 0.5 * (0.05 + 0.95)), 1e-15);
  EXPECT_EQ(score.precision, 0.5);
  EXPECT_EQ(score.recall, 0.5);
}

TEST(AnymateJoint, TheThresholdIsStrict) {
  const Points truth = {{0, 0, 0}, {1, 0, 0}}, predicted = {{0.25, 0, 0}, {1, 0, 0}};
  EXPECT_EQ(anymate_joint(predicted, truth, 0.25).precision, 0.5);
  EXPECT_EQ(anymate_joint(predicted, truth, 0.26).precision, 1.0);
}

TEST(AnymateJoint, LeavesOutFewerThanTwoPredictions) {
  EXPECT_FALSE(anymate_joint({{0, 0, 0}}, {{0, 0, 0}, {1, 0, 0}}).not_computed.empty());
  EXPECT_FALSE(anymate_joint({}, {{0, 0, 0}}).not_computed.empty());
  EXPECT_THROW(anymate_joint({{0, 0, 0}, {1, 0, 0}}, {}), InputError);
}

TEST(AnymateJoint, ReleasedEmdIsTheTransportCostWhereTheIterationConverges) {
  // Far apart clusters of equal size: each moves to its own, by 0.1 and 0.2.
  const Points a = {{0, 0, 0}, {5, 0, 0}}, b = {{5.2, 0, 0}, {0, 0.1, 0}};
  const ReleasedEmd emd = anymate_emd(a, b);
  EXPECT_NEAR(emd.cost, 0.15, 1e-9);
  EXPECT_NEAR(emd.plan_mass, 1.0, 1e-9);
  EXPECT_LT(emd.iterations, 100);
  EXPECT_NEAR(anymate_emd(a, a).cost, 0.0, 1e-12);
}

TEST(AnymateJoint, ReleasedEmdFollowsTheIterationWithoutShortcuts) {
  Rng rng(3, "anymate_emd");
  Points a, b;
  for (int i = 0; i < 9; ++i) a.push_back({rng.uniform(-1, 1), rng.uniform(-1, 1), rng.uniform(-1, 1)});
  for (int i = 0; i < 7; ++i) b.push_back({rng.uniform(-1, 1), rng.uniform(-1, 1), rng.uniform(-1, 1)});
  const std::size_t n = a.size(), m = b.size();
  std::vector<double> u(n, 0), v(m, 0);
  const double eps = 1e-4;
  for (int iteration = 0; iteration < 100; ++iteration) {
    double moved_u = 0, moved_v = 0;
    for (std::size_t i = 0; i < n; ++i) {
      double top = -1e300, sum = 0;
      for (std::size_t k = 0; k < m; ++k) top = std::max(top, (v[k] - (a[i] - b[k]).norm()) / eps);
      for (std::size_t k = 0; k < m; ++k) sum += std::exp((v[k] - (a[i] - b[k]).norm()) / eps - top);
      const double next = eps * (std::log(1.0 / 9) - top - std::log(sum));
      moved_u += std::abs(next - u[i]);
      u[i] = next;
    }
    for (std::size_t k = 0; k < m; ++k) {
      double top = -1e300, sum = 0;
      for (std::size_t i = 0; i < n; ++i) top = std::max(top, (u[i] - (a[i] - b[k]).norm()) / eps);
      for (std::size_t i = 0; i < n; ++i) sum += std::exp((u[i] - (a[i] - b[k]).norm()) / eps - top);
      const double next = eps * (std::log(1.0 / 7) - top - std::log(sum));
      moved_v += std::abs(next - v[k]);
      v[k] = next;
    }
    if (moved_u < 1e-3 && moved_v < 1e-3) break;
  }
  double cost = 0, mass = 0;
  for (std::size_t i = 0; i < n; ++i) {
    for (std::size_t k = 0; k < m; ++k) {
      const double d = (a[i] - b[k]).norm(), plan = std::exp((u[i] + v[k] - d) / eps);
      mass += plan;
      cost += plan * d;
    }
  }
  const ReleasedEmd emd = anymate_emd(a, b);
  // Differences of 1e-16 in the potentials are divided by 1e-4.
  EXPECT_NEAR(emd.cost, cost, 1e-9);
  EXPECT_NEAR(emd.plan_mass, mass, 1e-9);
}

TEST(AnymateConnectivity, APerfectPredictionIsFullAlsoForTheRoot) {
  // Root 1: with its diagonal zeroed, its "parent" becomes joint 0 on both sides.
  const MatrixXd truth = one_hot({1, -1, 1});
  const AnymateConnectivityScore score = anymate_connectivity(truth, truth);
  EXPECT_EQ(score.precision, 1.0);
  EXPECT_EQ(score.recall, 1.0);
  EXPECT_NEAR(score.cross_entropy, -std::log(1.0 + 1e-6), 1e-15);
}

TEST(AnymateConnectivity, AgreesWithHandComputedNumbers) {
  // A chain 0 ← 1 ← 2; the prediction hangs 2 on 0. True links: 0–0 (from the root's empty row), 0–1, 1–2.
  const MatrixXd truth = one_hot({-1, 0, 1});
  MatrixXd predicted(3, 3);
  predicted << 0.8, 0.1, 0.1,  //
      0.7, 0.2, 0.1,           //
      0.6, 0.3, 0.1;
  // Choices without the diagonal: 0 → 1 (the first of equals), 1 → 0, 2 → 0. Right: 0–1, 1–0. Wrong: 2–0.
  // True parents (0, 0, 1): predicted links are 0–1 and 0–2, so joint 0's 0–0 and joint 2's 2–1 are missed.
  const AnymateConnectivityScore score = anymate_connectivity(predicted, truth);
  EXPECT_DOUBLE_EQ(score.precision, 2.0 / 3);
  EXPECT_DOUBLE_EQ(score.recall, 2.0 / 4);
  EXPECT_NEAR(score.cross_entropy, -(std::log(0.8) + std::log(0.7) + std::log(0.3)) / 3, 1e-5);
}

TEST(AnymateConnectivity, RejectsBadMatrices) {
  EXPECT_THROW(anymate_connectivity(MatrixXd::Ones(2, 2), MatrixXd::Ones(3, 3)), InputError);
  EXPECT_THROW(anymate_connectivity(MatrixXd(0, 0), MatrixXd(0, 0)), InputError);
  EXPECT_THROW(anymate_connectivity(MatrixXd::Constant(2, 2, -0.1), MatrixXd::Ones(2, 2)), InputError);
  EXPECT_THROW(anymate_connectivity(MatrixXd::Constant(2, 2, std::nan("")), MatrixXd::Ones(2, 2)), InputError);
}

TEST(AnymateTree, FollowsConfidentProbabilitiesReadTransposed) {
  // The published tree reads cost[u, v] with u in the tree, so symmetric probabilities are what it gets right.
  const Points joints = {{0, -0.5, 0}, {0.05, 0, 0}, {0.1, 0.5, 0}, {0.5, 0.1, 0}};
  MatrixXd links = MatrixXd::Zero(4, 4);
  links(0, 1) = links(1, 0) = links(1, 2) = links(2, 1) = links(1, 3) = links(3, 1) = 1.0;
  links(0, 0) = 0.5;
  const AnymateTree skeleton = grow_anymate_tree(joints, links, everywhere());
  EXPECT_EQ(skeleton.root, 0);
  EXPECT_EQ(skeleton.tree.parents, (std::vector<int>{-1, 0, 1, 1}));
}

TEST(AnymateTree, PenalisesBonesOutsideTheMesh) {
  const Points joints = {{0.5, 0, 0}, {0.7, 0, 0}, {0.9, 0, 0}};
  MatrixXd links = MatrixXd::Constant(3, 3, 1.0);
  // Everything is outside: bones of 20 and 40 samples.
  const MatrixXd outside = anymate_bone_costs(joints, links, AnymateOccupancy({}));
  EXPECT_EQ(outside(0, 1), 40.0);
  EXPECT_EQ(outside(2, 0), 80.0);
  const MatrixXd inside = anymate_bone_costs(joints, links, everywhere());
  EXPECT_NEAR(inside(0, 1), std::log(2.0), 1e-6);
  EXPECT_NEAR(inside(0, 0), -std::log(1e-10), 1e-6);
}

TEST(AnymateTree, HalvesCostsInTheMiddlePlane) {
  const Points joints = {{0.01, 0, 0}, {-0.01, 0.2, 0}, {0.02, 0.4, 0}};
  const MatrixXd cost = anymate_bone_costs(joints, MatrixXd::Constant(3, 3, 1.0), everywhere());
  EXPECT_NEAR(cost(0, 1), 0.5 * std::log(2.0), 1e-6);
  EXPECT_NEAR(cost(0, 2), std::log(2.0), 1e-6);  // |x| must be below 0.02
}

TEST(AnymateTree, DoesNotFoldBack) {
  // From the root 0 to 1; then 2, which lies behind 1 on the way back to 0, goes to 0 although 1 is more probable.
  const Points joints = {{0, 0, 0}, {0.5, 0, 0}, {0.25, 0, 0}};
  MatrixXd cost(3, 3);
  cost << 1, 0.1, 3,  //
      0.1, 1, 0.2,    //
      3, 0.2, 1;
  EXPECT_EQ(anymate_parents(joints, cost, 0), (std::vector<int>{-1, 0, 0}));
  // In front of 1 it may follow.
  EXPECT_EQ(anymate_parents({{0, 0, 0}, {0.5, 0, 0}, {0.75, 0, 0}}, cost, 0), (std::vector<int>{-1, 0, 1}));
}

TEST(AnymateTree, IsDefinedForCoincidentAndUnreachableJoints) {
  const Points same(3, Vector3d::Zero());
  const AnymateTree skeleton = grow_anymate_tree(same, MatrixXd::Constant(3, 3, 1.0 / 3), everywhere());
  EXPECT_NO_THROW(check(skeleton.tree, ""));
  EXPECT_EQ(roots(skeleton.tree).size(), 1u);
  // Edges without positive cost are no edges.
  EXPECT_EQ(anymate_parents(same, MatrixXd::Zero(3, 3), 1), (std::vector<int>{-1, -1, -1}));
}

TEST(AnymateTree, RejectsBadInput) {
  EXPECT_THROW(AnymateOccupancy({{0, 0, 64}}), InputError);
  EXPECT_THROW(AnymateOccupancy({{0, -1, 0}}), InputError);
  const AnymateOccupancy all = everywhere();
  EXPECT_THROW(grow_anymate_tree({}, MatrixXd(0, 0), all), InputError);
  EXPECT_THROW(grow_anymate_tree({{0, 0, 0}}, MatrixXd::Ones(2, 2), all), InputError);
  EXPECT_THROW(grow_anymate_tree({{std::nan(""), 0, 0}}, MatrixXd::Ones(1, 1), all), InputError);
  EXPECT_THROW(grow_anymate_tree({{1e9, 0, 0}}, MatrixXd::Ones(1, 1), all), InputError);
  EXPECT_TRUE(all.contains({5, -7, 1}));  // clipped to the grid
}

}  // namespace

namespace {

using Bones = std::vector<std::array<int, 2>>;

Bones ends_of(const MetricSkeleton& skeleton) {
  Bones ends;
  for (const geometry::Bone& bone : skeleton.bones) ends.push_back({bone.parent, bone.joint});
  return ends;
}

TEST(PuppeteerCleaning, LeavesACleanTreeAsItIs) {
  const JointTree tree{{{0, 0, 0}, {0.1, 0, 0}, {0.2, 0, 0}}, {-1, 0, 1}};
  const MetricSkeleton clean = puppeteer_cleaned(tree);
  EXPECT_EQ(clean.positions, tree.positions);
  EXPECT_EQ(ends_of(clean), (Bones{{0, 1}, {1, 2}}));
}

TEST(PuppeteerCleaning, MergesNearJointsIntoTheFirst) {
  // 1 and 2 are 0.002 apart, and the bone between them goes; 3 hangs on the merged joint now.
  const JointTree tree{{{0, 0, 0}, {0.1, 0, 0}, {0.102, 0, 0}, {0.2, 0, 0}}, {-1, 0, 1, 2}};
  const MetricSkeleton clean = puppeteer_cleaned(tree);
  ASSERT_EQ(clean.positions.size(), 3u);
  EXPECT_EQ(clean.positions[1], tree.positions[1]);
  EXPECT_EQ(ends_of(clean), (Bones{{0, 1}, {1, 2}}));
}

TEST(PuppeteerCleaning, GroupsAroundTheirFirstJointOnly) {
  // 0.002 between neighbours: 1 takes in 2 but not 3, which is 0.004 away.
  const JointTree tree{{{0, 0, 0}, {0.1, 0, 0}, {0.102, 0, 0}, {0.104, 0, 0}}, {-1, 0, 1, 2}};
  const MetricSkeleton clean = puppeteer_cleaned(tree);
  ASSERT_EQ(clean.positions.size(), 3u);
  EXPECT_EQ(clean.positions[2], tree.positions[3]);
}

TEST(PuppeteerCleaning, TheRootStandsForItsGroup) {
  const JointTree tree{{{0.001, 0, 0}, {0, 0, 0}, {0.1, 0, 0}}, {1, -1, 0}};
  const MetricSkeleton clean = puppeteer_cleaned(tree);
  ASSERT_EQ(clean.positions.size(), 2u);
  EXPECT_EQ(clean.positions[0], tree.positions[1]);
  EXPECT_EQ(ends_of(clean), (Bones{{0, 1}}));
}

TEST(PuppeteerCleaning, DropsRepeatedBonesOfMergedBranches) {
  // Two tips in one place below the same joint.
  const JointTree tree{{{0, 0, 0}, {0.1, 0, 0}, {0.1, 0.001, 0}}, {-1, 0, 0}};
  const MetricSkeleton clean = puppeteer_cleaned(tree);
  EXPECT_EQ(clean.positions.size(), 2u);
  EXPECT_EQ(ends_of(clean), (Bones{{0, 1}}));
}

TEST(PuppeteerCleaning, ConnectsComponentsNearestFirst) {
  // Three bones in a row with gaps of 0.01 (made one joint) and 0.05 (gets a bone); a lone joint is dropped.
  const JointTree tree{{{0, 0, 0}, {0.1, 0, 0}, {0.11, 0, 0}, {0.2, 0, 0}, {0.25, 0, 0}, {0.4, 0, 0}, {0, 0.4, 0}},
                       {-1, 0, -1, 2, -1, 4, -1}};
  const MetricSkeleton clean = puppeteer_cleaned(tree);
  ASSERT_EQ(clean.positions.size(), 5u);
  EXPECT_EQ(clean.positions[1], tree.positions[1]);  // the lower index stays
  EXPECT_EQ(clean.positions[2], tree.positions[3]);
  EXPECT_EQ(ends_of(clean), (Bones{{0, 1}, {1, 2}, {3, 4}, {2, 3}}));
}

TEST(PuppeteerCleaning, ALoneRootIsConnected) {
  const JointTree tree{{{0, 0, 0}, {0.1, 0, 0}, {0.2, 0, 0}}, {-1, -1, 1}};
  const MetricSkeleton clean = puppeteer_cleaned(tree);
  ASSERT_EQ(clean.positions.size(), 3u);
  EXPECT_EQ(ends_of(clean), (Bones{{1, 2}, {0, 1}}));
}

TEST(PuppeteerCleaning, WithoutBonesJointsStay) {
  const JointTree tree{{{0, 0, 0}, {0.001, 0, 0}, {0.2, 0, 0}}, {-1, -1, -1}};
  const MetricSkeleton clean = puppeteer_cleaned(tree);
  EXPECT_EQ(clean.positions.size(), 2u);
  EXPECT_EQ(ends_of(clean), (Bones{{0, 0}, {1, 1}}));  // which stand for themselves
}

TEST(PuppeteerCleaning, RefusesHugeForests) {
  JointTree forest;
  for (int i = 0; i < 4000; ++i) {
    forest.positions.push_back({0.01 * (i / 2), 0.1 * (i % 2), 0});
    forest.parents.push_back(i % 2 == 0 ? -1 : i - 1);
  }
  EXPECT_THROW(puppeteer_cleaned(forest), InputError);
  EXPECT_NO_THROW(puppeteer_cleaned(connected(forest)));
}

TEST(PuppeteerCleaning, IsWhatTheProtocolMeasures) {
  const JointTree truth{{{0, 0, 0}, {0.3, 0, 0}}, {-1, 0}};
  const JointTree doubled{{{0, 0, 0}, {0.3, 0, 0}, {0.3, 0.002, 0}}, {-1, 0, 0}};
  EXPECT_EQ(skeleton_chamfer(doubled, truth, SkeletonProtocol::kPuppeteer).j2j, 0.0);
  EXPECT_GT(skeleton_chamfer(doubled, truth, SkeletonProtocol::kRignet).j2j, 1e-4);
}

}  // namespace

}  // namespace anigen::metrics
