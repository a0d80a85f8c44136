// Transport of one pair of skeletons as the front end calls it, on good and on odd input.
#include "anigen/metrics/skeleton_transport.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "anigen/core/error.h"
#include "anigen/metrics/transport_plan.h"
#include "anigen/metrics/wasserstein.h"
#include "tests/metrics/transport_trees.h"

namespace anigen::metrics {
namespace {

void expect_coupling(const SkeletonTransport& found, std::size_t n, std::size_t m) {
  ASSERT_EQ(static_cast<std::size_t>(found.plan.rows()), n);
  ASSERT_EQ(static_cast<std::size_t>(found.plan.cols()), m);
  EXPECT_LT(test::marginal_error(found.plan, uniform_masses(n), uniform_masses(m)), 1e-13);
  EXPECT_LE(found.gw_lower_bound, found.gromov_wasserstein);
}

TEST(SkeletonTransport, IdenticalSkeletonsAreAtDistanceZero) {
  Rng rng(0, "test");
  const JointTree tree = test::random_tree(30, rng);
  for (const JointTree& copy : {tree, test::relabelled(tree, rng)}) {
    const SkeletonTransport found = skeleton_transport(tree, copy);
    expect_coupling(found, 30, 30);
    EXPECT_EQ(found.wasserstein, 0.0);
    EXPECT_EQ(found.gromov_wasserstein, 0.0);
    EXPECT_EQ(found.fused_gromov_wasserstein, 0.0);
    EXPECT_EQ(found.gw_lower_bound, 0.0);
    EXPECT_TRUE(std::isnan(found.sinkhorn_wasserstein));
  }
}

TEST(SkeletonTransport, PlanBelongsToTheJointsAsGiven) {
  for (std::uint64_t seed = 0; seed < 5; ++seed) {
    Rng rng(seed, "test");
    const JointTree x = test::relabelled(test::random_tree(13, rng), rng);
    const JointTree y = test::relabelled(test::random_tree(17, rng), rng);
    const SkeletonTransport found = skeleton_transport(x, y);
    expect_coupling(found, 13, 17);
    const double cost = (found.plan.array() * squared_distances(x.positions, y.positions).array()).sum();
    EXPECT_NEAR(std::sqrt(cost), found.wasserstein, 1e-12);
    EXPECT_NEAR(found.wasserstein, wasserstein2(x.positions, y.positions).distance, 1e-12);
  }
}

TEST(SkeletonTransport, OrderOfJointsDoesNotMatter) {
  for (std::uint64_t seed = 0; seed < 5; ++seed) {
    Rng rng(seed, "test");
    JointTree x = test::random_tree(21, rng), y = test::random_tree(18, rng);
    x.positions[7] = x.positions[static_cast<std::size_t>(x.parents[7])];  // two joints at one place
    const SkeletonTransport one = skeleton_transport(x, y);
    const SkeletonTransport two = skeleton_transport(test::relabelled(x, rng), test::relabelled(y, rng));
    EXPECT_NEAR(one.wasserstein, two.wasserstein, 1e-12);
    EXPECT_NEAR(one.gromov_wasserstein, two.gromov_wasserstein, 1e-12);
    EXPECT_NEAR(one.fused_gromov_wasserstein, two.fused_gromov_wasserstein, 1e-12);
    EXPECT_NEAR(one.gw_lower_bound, two.gw_lower_bound, 1e-9);
  }
}

TEST(SkeletonTransport, RigidMotionChangesOnlyWhatSeesPositions) {
  Rng rng(1, "test");
  const JointTree tree = test::random_tree(20, rng);
  JointTree moved = tree;
  for (Eigen::Vector3d& p : moved.positions) p += Eigen::Vector3d(0.0, 2.0, 0.0);
  const SkeletonTransport found = skeleton_transport(moved, tree);
  EXPECT_NEAR(found.wasserstein, 2.0, 1e-12);
  EXPECT_LT(found.gromov_wasserstein, 1e-12);
  // Half of the squared translation; the isometry costs nothing more.
  EXPECT_NEAR(found.fused_gromov_wasserstein, std::sqrt(2.0), 1e-9);
}

TEST(SkeletonTransport, SinkhornOnlyWhenAskedAndWithinItsGap) {
  Rng rng(2, "test");
  const JointTree x = test::random_tree(15, rng), y = test::random_tree(11, rng);
  TransportOptions options;
  options.sinkhorn = true;
  const SkeletonTransport found = skeleton_transport(x, y, options);
  const double exact = found.wasserstein * found.wasserstein;
  const double approximate = found.sinkhorn_wasserstein * found.sinkhorn_wasserstein;
  EXPECT_GE(approximate, exact - 1e-9);
  EXPECT_LE(approximate - found.sinkhorn_gap, exact + 1e-9);
}

TEST(SkeletonTransport, SingleJointForestAndCoincidentJoints) {
  const JointTree one{{{0.1, 0.2, 0.3}}, {-1}};
  const JointTree forest{{{0, 0, 0}, {1, 0, 0}, {0, 3, 0}, {0, 3, 4}}, {-1, 0, -1, 2}};
  const JointTree twins{{{0, 0, 0}, {1, 0, 0}, {1, 0, 0}, {1, 0, 0}}, {-1, 0, 0, 2}};
  const JointTree stacked{{{1, 1, 1}, {1, 1, 1}, {1, 1, 1}}, {-1, 0, 1}};
  const std::vector<JointTree> all = {one, forest, twins, stacked};
  for (const JointTree& x : all) {
    for (const JointTree& y : all) {
      const SkeletonTransport found = skeleton_transport(x, y);
      expect_coupling(found, x.size(), y.size());
      for (const double value : {found.wasserstein, found.gromov_wasserstein, found.fused_gromov_wasserstein}) {
        EXPECT_TRUE(std::isfinite(value));
        EXPECT_GE(value, 0.0);
        if (&x == &y) {
          EXPECT_LT(value, 1e-12);
        }
      }
    }
  }
  // No extent on either side: only positions differ.
  const SkeletonTransport apart = skeleton_transport(one, stacked);
  EXPECT_EQ(apart.gromov_wasserstein, 0.0);
  EXPECT_NEAR(apart.wasserstein, std::sqrt(0.81 + 0.64 + 0.49), 1e-12);
}

TEST(SkeletonTransport, RefusesBrokenSkeletonsNamingTheSide) {
  const JointTree good{{{0, 0, 0}, {1, 0, 0}}, {-1, 0}};
  JointTree unset = good;
  unset.positions[1].x() = std::numeric_limits<double>::quiet_NaN();
  for (const JointTree& bad :
       {JointTree{}, unset, JointTree{good.positions, {1, 0}}, JointTree{good.positions, {-1}}}) {
    EXPECT_THROW(skeleton_transport(good, bad), InputError);
    try {
      skeleton_transport(MetricSkeleton(bad, "predicted skeleton"), good);
      ADD_FAILURE() << "accepted";
    } catch (const InputError& error) {
      EXPECT_EQ(error.file(), "predicted skeleton");
    }
  }
}

TEST(SkeletonTransport, SeesAnInsertedJointAndADuplicatedBranch) {
  // The paper's examples (section 4.1.3) of what Chamfer distances miss: both leave the shape almost as it is.
  Rng rng(6, "test");
  const JointTree tree = test::random_tree(20, rng);
  JointTree inserted = tree;
  inserted.positions.push_back(0.5 * (tree.positions[5] + tree.positions[static_cast<std::size_t>(tree.parents[5])]));
  inserted.parents.push_back(tree.parents[5]);
  inserted.parents[5] = 20;
  JointTree duplicated = tree;
  duplicated.positions.push_back(tree.positions[19] + Eigen::Vector3d(1e-3, 0.0, 0.0));
  duplicated.parents.push_back(tree.parents[19]);
  for (const JointTree& changed : {inserted, duplicated}) {
    const SkeletonTransport found = skeleton_transport(changed, tree);
    EXPECT_GT(found.wasserstein, 1e-2);
    EXPECT_GT(found.gromov_wasserstein, 1e-2);
    EXPECT_GT(found.gw_lower_bound, 1e-3);
  }
}

}  // namespace
}  // namespace anigen::metrics
