// Distances along skeletons, and the trees behind distance matrices.
#include "anigen/eval/transport/tree_geodesics.h"

#include <gtest/gtest.h>

#include "anigen/core/error.h"
#include "anigen/eval/transport/canonical_order.h"
#include "anigen/eval/transport/metric_tree.h"
#include "anigen/eval/transport/transport_plan.h"
#include "tests/eval/transport_trees.h"

namespace anigen::eval {
namespace {

using Eigen::MatrixXd;

// Floyd and Warshall over the bones.
MatrixXd relaxed_distances(const io::JointTree& tree) {
  const Eigen::Index n = static_cast<Eigen::Index>(tree.size());
  MatrixXd d = MatrixXd::Constant(n, n, 1e9);
  for (Eigen::Index j = 0; j < n; ++j) {
    d(j, j) = 0.0;
    const int parent = tree.parents[static_cast<std::size_t>(j)];
    if (parent < 0) continue;
    d(j, parent) = d(parent, j) =
        (tree.positions[static_cast<std::size_t>(j)] - tree.positions[static_cast<std::size_t>(parent)]).norm();
  }
  for (Eigen::Index k = 0; k < n; ++k) {
    for (Eigen::Index i = 0; i < n; ++i) {
      for (Eigen::Index j = 0; j < n; ++j) d(i, j) = std::min(d(i, j), d(i, k) + d(k, j));
    }
  }
  return d;
}

TEST(TreeGeodesics, EqualsShortestPathsInAnyOrderOfJoints) {
  for (std::uint64_t seed = 0; seed < 10; ++seed) {
    Rng rng(seed, "test");
    const io::JointTree tree = test::relabelled(test::random_tree(1 + rng.index(30), rng), rng);
    EXPECT_LT((tree_geodesics(tree) - relaxed_distances(tree)).cwiseAbs().maxCoeff(), 1e-12);
  }
}

TEST(TreeGeodesics, FurtherRootsHangOnTheFirst) {
  const io::JointTree forest{{{0, 0, 0}, {1, 0, 0}, {0, 3, 0}, {0, 3, 4}}, {-1, 0, -1, 2}};
  const MatrixXd d = tree_geodesics(forest);
  EXPECT_DOUBLE_EQ(d(0, 2), 3.0);
  EXPECT_DOUBLE_EQ(d(1, 3), 8.0);
}

TEST(TreeGeodesics, RefusesCyclesAndNothing) {
  EXPECT_THROW(tree_geodesics({}), InputError);
  EXPECT_THROW(tree_geodesics({{{0, 0, 0}, {1, 0, 0}}, {1, 0}}), InputError);
}

TEST(MetricTree, IsFoundAgainInItsDistances) {
  for (std::uint64_t seed = 0; seed < 10; ++seed) {
    Rng rng(seed, "test");
    io::JointTree tree = test::random_tree(1 + rng.index(30), rng);
    if (tree.size() > 4)
      tree.positions[3] = tree.positions[static_cast<std::size_t>(tree.parents[3])];  // a bone of length 0
    const MatrixXd d = tree_geodesics(tree);
    const auto found = metric_tree(d);
    ASSERT_TRUE(found.has_value());
    EXPECT_LT((path_lengths(*found) - d).cwiseAbs().maxCoeff(), 1e-12);
    const RowMatrix values = test::random_matrix(tree.size(), 7, rng);
    EXPECT_LT((multiply(*found, values) - d * values).cwiseAbs().maxCoeff(), 1e-10);
  }
}

TEST(MetricTree, OtherMetricsHaveNone) {
  MatrixXd square(4, 4);  // a cycle of four unit edges
  square << 0, 1, 2, 1, 1, 0, 1, 2, 2, 1, 0, 1, 1, 2, 1, 0;
  EXPECT_FALSE(metric_tree(square).has_value());
}

LabelledTree labelled(const io::JointTree& tree) {
  return {*metric_tree(tree_geodesics(tree)), uniform_masses(tree.size()), {}};
}

TEST(CanonicalOrder, DoesNotDependOnLabels) {
  for (std::uint64_t seed = 0; seed < 20; ++seed) {
    Rng rng(seed, "test");
    io::JointTree tree = test::random_tree(2 + rng.index(30), rng);
    if (seed % 2 == 0 && tree.size() > 4) tree.positions[3] = tree.positions[static_cast<std::size_t>(tree.parents[3])];
    const CanonicalOrder order = canonical_order(labelled(tree), labelled(test::relabelled(tree, rng)));
    EXPECT_TRUE(order.isomorphic);
    EXPECT_EQ(order.first_tree.parents, order.second_tree.parents);
    EXPECT_EQ(path_lengths(order.first_tree), path_lengths(order.second_tree));
  }
}

TEST(CanonicalOrder, TellsTreesApart) {
  Rng rng(4, "test");
  const io::JointTree tree = test::random_tree(12, rng);
  io::JointTree longer = tree, rehung = tree;
  longer.positions[11] += Eigen::Vector3d(0.0, 0.0, 1e-3);
  rehung.parents[11] = rehung.parents[11] == 0 ? 1 : 0;
  EXPECT_FALSE(canonical_order(labelled(tree), labelled(longer)).isomorphic);
  EXPECT_FALSE(canonical_order(labelled(tree), labelled(rehung)).isomorphic);
}

}  // namespace
}  // namespace anigen::eval
