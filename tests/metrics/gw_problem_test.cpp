#include <gtest/gtest.h>
#include <Eigen/Geometry>
#include <algorithm>
#include <numeric>

#include "anigen/core/error.h"
#include "anigen/metrics/entropic_gw.h"
#include "anigen/metrics/gromov_wasserstein.h"
#include "anigen/metrics/gw_bound.h"
#include "anigen/metrics/gw_problem.h"
#include "anigen/metrics/transport_plan.h"
#include "anigen/metrics/wasserstein.h"
#include "tests/metrics/transport_trees.h"
#include "tests/support/kernel_forms.h"

// Distances along skeletons, and the trees behind distance matrices.

// Gromov–Wasserstein and its fused form: global optima of tiny problems, invariances, bounds, degenerate spaces.

namespace anigen::metrics {

namespace {

using Eigen::MatrixXd;

// Floyd and Warshall over the bones.
MatrixXd relaxed_distances(const JointTree& tree) {
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
    const JointTree tree = test::relabelled(test::random_tree(1 + rng.index(30), rng), rng);
    EXPECT_LT((tree_geodesics(tree) - relaxed_distances(tree)).cwiseAbs().maxCoeff(), 1e-12);
  }
}

TEST(TreeGeodesics, FurtherRootsHangOnTheFirst) {
  const JointTree forest{{{0, 0, 0}, {1, 0, 0}, {0, 3, 0}, {0, 3, 4}}, {-1, 0, -1, 2}};
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
    JointTree tree = test::random_tree(1 + rng.index(30), rng);
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

LabelledTree labelled(const JointTree& tree) {
  return {*metric_tree(tree_geodesics(tree)), uniform_masses(tree.size()), {}};
}

TEST(CanonicalOrder, DoesNotDependOnLabels) {
  for (std::uint64_t seed = 0; seed < 20; ++seed) {
    Rng rng(seed, "test");
    JointTree tree = test::random_tree(2 + rng.index(30), rng);
    if (seed % 2 == 0 && tree.size() > 4) tree.positions[3] = tree.positions[static_cast<std::size_t>(tree.parents[3])];
    const CanonicalOrder order = canonical_order(labelled(tree), labelled(test::relabelled(tree, rng)));
    EXPECT_TRUE(order.isomorphic);
    EXPECT_EQ(order.first_tree.parents, order.second_tree.parents);
    EXPECT_EQ(path_lengths(order.first_tree), path_lengths(order.second_tree));
  }
}

TEST(CanonicalOrder, TellsTreesApart) {
  Rng rng(4, "test");
  const JointTree tree = test::random_tree(12, rng);
  JointTree longer = tree, rehung = tree;
  longer.positions[11] += Eigen::Vector3d(0.0, 0.0, 1e-3);
  rehung.parents[11] = rehung.parents[11] == 0 ? 1 : 0;
  EXPECT_FALSE(canonical_order(labelled(tree), labelled(longer)).isomorphic);
  EXPECT_FALSE(canonical_order(labelled(tree), labelled(rehung)).isomorphic);
}

}  // namespace

namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

struct Spaces {
  JointTree x, y;
  MatrixXd c1, c2;
  VectorXd a, b;
};

Spaces spaces(JointTree x, JointTree y) {
  Spaces result{std::move(x), std::move(y), {}, {}, {}, {}};
  result.c1 = tree_geodesics(result.x);
  result.c2 = tree_geodesics(result.y);
  result.a = uniform_masses(result.x.size());
  result.b = uniform_masses(result.y.size());
  return result;
}

Spaces random_spaces(std::uint64_t seed, std::size_t n, std::size_t m) {
  Rng rng(seed, "test");
  JointTree x = test::random_tree(n, rng);
  return spaces(std::move(x), test::random_tree(m, rng));
}

GromovWasserstein solve(const Spaces& s) { return gromov_wasserstein(s.c1, s.c2, s.a, s.b); }

// Least of (1 - alpha) <M, P> + alpha GW(P) over permutations: for tree metrics the objective is concave on couplings,
// so with n = m this is the global minimum.
double enumerated(const Spaces& s, const MatrixXd& features, double alpha) {
  std::vector<int> order(s.x.size());
  std::iota(order.begin(), order.end(), 0);
  const double n = static_cast<double>(s.x.size());
  double best = 1e300;
  do {
    double quadratic = 0.0, linear = 0.0;
    for (Eigen::Index i = 0; i < s.c1.rows(); ++i) {
      linear += features(i, order[static_cast<std::size_t>(i)]);
      for (Eigen::Index k = 0; k < s.c1.rows(); ++k) {
        const double gap = s.c1(i, k) - s.c2(order[static_cast<std::size_t>(i)], order[static_cast<std::size_t>(k)]);
        quadratic += gap * gap;
      }
    }
    best = std::min(best, (1.0 - alpha) * linear / n + alpha * quadratic / (n * n));
  } while (std::next_permutation(order.begin(), order.end()));
  return best;
}

TEST(GromovWasserstein, FindsTheGlobalOptimumOfSmallTrees) {
  for (std::uint64_t seed = 0; seed < 40; ++seed) {
    const std::size_t n = 2 + seed % 6;
    const Spaces s = random_spaces(seed, n, n);
    const double best = enumerated(s, MatrixXd::Zero(s.c1.rows(), s.c2.rows()), 1.0);
    EXPECT_NEAR(solve(s).cost, best, 1e-12 * (1.0 + best)) << "seed " << seed;
  }
}

TEST(FusedGromovWasserstein, FindsTheGlobalOptimumOfSmallTrees) {
  for (std::uint64_t seed = 0; seed < 20; ++seed) {
    const std::size_t n = 2 + seed % 6;
    const Spaces s = random_spaces(seed, n, n);
    const MatrixXd features = squared_distances(s.x.positions, s.y.positions);
    const double best = enumerated(s, features, 0.5);
    EXPECT_NEAR(fused_gromov_wasserstein(features, s.c1, s.c2, s.a, s.b).cost, best, 1e-12 * (1.0 + best));
  }
}

TEST(GromovWasserstein, TwoPointsAgainstTwo) {
  // Both pairs count twice with mass 1/4: cost (3 - 1)^2 / 2.
  const Spaces s = spaces({{{0, 0, 0}, {3, 0, 0}}, {-1, 0}}, {{{5, 5, 5}, {5, 6, 5}}, {-1, 0}});
  EXPECT_NEAR(solve(s).value, std::sqrt(2.0), 1e-15);
}

TEST(GromovWasserstein, SinglePointHasOneCoupling) {
  const Spaces s = random_spaces(1, 1, 9);
  const double spread = std::sqrt(s.c2.cwiseAbs2().mean());
  EXPECT_NEAR(solve(s).value, spread, 1e-12);
  EXPECT_LE(gw_lower_bound(s.c1, s.c2, s.a, s.b).best, spread);
  EXPECT_GT(gw_lower_bound(s.c1, s.c2, s.a, s.b).best, 0.999999 * spread);
  EXPECT_EQ(solve(random_spaces(1, 1, 1)).value, 0.0);
}

TEST(GromovWasserstein, ZeroExactlyForIdenticalTreesUnderAnyLabels) {
  for (std::uint64_t seed = 0; seed < 20; ++seed) {
    Rng rng(seed, "test");
    JointTree tree = test::random_tree(1 + rng.index(40), rng);
    if (seed % 3 == 0 && tree.size() > 4) tree.positions[3] = tree.positions[static_cast<std::size_t>(tree.parents[3])];
    const Spaces s = spaces(tree, test::relabelled(tree, rng));
    const GromovWasserstein found = solve(s);
    EXPECT_EQ(found.value, 0.0);
    EXPECT_EQ(found.start, "isomorphism");
    EXPECT_LT(test::marginal_error(found.plan, s.a, s.b), 1e-14);
  }
}

TEST(GromovWasserstein, ZeroForRotatedTreesAndProportionalForScaledOnes) {
  Rng rng(3, "test");
  const JointTree tree = test::random_tree(25, rng);
  JointTree turned = tree, doubled = tree;
  const Eigen::Matrix3d rotation = Eigen::Quaterniond(0.3, -0.5, 0.7, 0.1).normalized().toRotationMatrix();
  for (Eigen::Vector3d& p : turned.positions) p = rotation * p + Eigen::Vector3d(1, 2, 3);
  for (Eigen::Vector3d& p : doubled.positions) p *= 2.0;
  EXPECT_LT(solve(spaces(tree, turned)).value, 1e-12);
  // The identity is optimal between a tree and its double: cost = mean of d^2.
  const Spaces s = spaces(tree, doubled);
  EXPECT_NEAR(solve(s).cost, s.c1.cwiseAbs2().mean(), 1e-9);
}

TEST(GromovWasserstein, DoesNotDependOnLabelsOrSides) {
  for (std::uint64_t seed = 0; seed < 8; ++seed) {
    Rng rng(seed, "test");
    const JointTree x = test::random_tree(5 + rng.index(30), rng);
    const JointTree y = test::random_tree(seed % 2 == 0 ? x.size() : 5 + rng.index(30), rng);
    const double value = solve(spaces(x, y)).value;
    for (int shuffle = 0; shuffle < 3; ++shuffle) {
      const Spaces other = spaces(test::relabelled(x, rng), test::relabelled(y, rng));
      const GromovWasserstein found = solve(other);
      EXPECT_NEAR(found.value, value, 1e-12 * value);
      EXPECT_NEAR(gw_cost(other.c1, other.c2, found.plan), found.cost, 1e-9 * found.cost);
      EXPECT_LT(test::marginal_error(found.plan, other.a, other.b), 1e-13);
    }
  }
}

TEST(GromovWasserstein, LowerBoundsStayBelow) {
  for (std::uint64_t seed = 0; seed < 60; ++seed) {
    Rng rng(seed, "test");
    Spaces s = random_spaces(seed + 1000, 1 + rng.index(20), 1 + rng.index(20));
    if (seed % 3 == 0) {
      s.a = test::random_masses(s.x.size(), rng);
      s.b = test::random_masses(s.y.size(), rng);
    }
    const double value = solve(s).value;
    const GwLowerBound bound = gw_lower_bound(s.c1, s.c2, s.a, s.b);
    EXPECT_LE(bound.best, value);
    // Mixing the local couplings gives a global one, so the third bound is never the weaker.
    EXPECT_GE(bound.local_distances, bound.global_distances - 1e-5);
  }
}

TEST(GromovWasserstein, LowerBoundsStayBelowGlobalOptima) {
  for (std::uint64_t seed = 0; seed < 40; ++seed) {
    const std::size_t n = 2 + seed % 6;
    const Spaces s = random_spaces(seed, n, n);
    const double best = std::sqrt(enumerated(s, MatrixXd::Zero(s.c1.rows(), s.c2.rows()), 1.0));
    const GwLowerBound bound = gw_lower_bound(s.c1, s.c2, s.a, s.b);
    for (const double value : {bound.global_distances, bound.local_distances, bound.spectral}) EXPECT_LE(value, best);
    EXPECT_GT(bound.best, 0.2 * best);  // and they say something
  }
}

TEST(GromovWasserstein, UnequalMassesAndOtherMetrics) {
  // Points of a cycle have no tree; the search must still end in a coupling no worse than conditional gradient's.
  Rng rng(5, "test");
  MatrixXd circle(9, 9);
  for (int i = 0; i < 9; ++i) {
    for (int k = 0; k < 9; ++k) circle(i, k) = std::min((i - k + 9) % 9, (k - i + 9) % 9);
  }
  const MatrixXd other = tree_geodesics(test::random_tree(7, rng));
  const VectorXd a = test::random_masses(9, rng), b = test::random_masses(7, rng);
  const GromovWasserstein found = gromov_wasserstein(circle, other, a, b);
  EXPECT_LT(test::marginal_error(found.plan, a, b), 1e-10);
  EXPECT_NEAR(gw_cost(circle, other, found.plan), found.cost, 1e-9 * found.cost);
  EXPECT_LE(found.cost, gw_conditional_gradient(circle, other, a, b, a * b.transpose()).cost + 1e-9);
  EXPECT_LE(gw_lower_bound(circle, other, a, b).best, found.value);
}

TEST(GromovWasserstein, DenseStartsOfLargeSpacesDoNotTakeForever) {
  // Work on all pairs of cells would be 10^9 steps for a dense start here; points without extent never leave it.
  const Spaces s = random_spaces(7, 150, 200);
  const MatrixXd product = s.a * s.b.transpose();
  const GromovWasserstein found = gromov_wasserstein(s.c1, s.c2, s.a, s.b, {{"dense", product}});
  EXPECT_LE(found.cost, gw_conditional_gradient(s.c1, s.c2, s.a, s.b, product).cost + 1e-9);
  const MatrixXd zero1 = MatrixXd::Zero(150, 150), zero2 = MatrixXd::Zero(200, 200);
  EXPECT_EQ(gromov_wasserstein(zero1, zero2, s.a, s.b, {{"dense", product}}).value, 0.0);
}

TEST(GromovWasserstein, NeverWorseThanConditionalGradientFromItsStarts) {
  for (std::uint64_t seed = 0; seed < 6; ++seed) {
    const Spaces s = random_spaces(seed, 20 + 5 * seed, 40);
    const MatrixXd matched = wasserstein2(s.x.positions, s.y.positions).plan;
    const GromovWasserstein found = gromov_wasserstein(s.c1, s.c2, s.a, s.b, {{"wasserstein", matched}});
    for (const MatrixXd& start : {MatrixXd(s.a * s.b.transpose()), matched}) {
      const GwConditionalGradient published = gw_conditional_gradient(s.c1, s.c2, s.a, s.b, start);
      EXPECT_LE(published.cost, gw_cost(s.c1, s.c2, start) + 1e-12);
      EXPECT_LE(found.cost, published.cost + 1e-6);
    }
  }
}

TEST(GromovWasserstein, EntropicVariantsAreCouplingsAboveTheVertex) {
  const Spaces s = random_spaces(2, 12, 9);
  const double vertex = solve(s).cost;
  EntropicGwOptions options;
  options.epsilon = 0.02;
  for (const EntropicGwSolver solver : {EntropicGwSolver::kProjectedGradient, EntropicGwSolver::kProximalPoint}) {
    options.solver = solver;
    const EntropicGw found = entropic_gromov_wasserstein(s.c1, s.c2, s.a, s.b, options);
    EXPECT_LT(found.marginal_error, 1e-3);
    EXPECT_GE(found.cost, vertex - 1e-3);
    EXPECT_LE(found.cost, gw_cost(s.c1, s.c2, s.a * s.b.transpose()));
  }
  GromovWassersteinOptions search;
  search.entropic = true;
  EXPECT_LE(gromov_wasserstein(s.c1, s.c2, s.a, s.b, {}, search).cost, vertex + 1e-9);
}

TEST(GromovWasserstein, EveryFormOfKernelsGivesTheSameBits) {
  const Spaces s = random_spaces(11, 23, 30);
  std::vector<GromovWasserstein> found;
  test::in_every_kernel_form([&] { found.push_back(solve(s)); });
  for (const GromovWasserstein& other : found) {
    EXPECT_EQ(other.cost, found[0].cost);
    EXPECT_EQ(other.plan, found[0].plan);
  }
}

TEST(FusedGromovWasserstein, LiesBetweenItsBounds) {
  for (std::uint64_t seed = 0; seed < 10; ++seed) {
    const Spaces s = random_spaces(seed, 10 + seed, 14);
    const MatrixXd features = squared_distances(s.x.positions, s.y.positions);
    const JointTransport matched = wasserstein2(s.x.positions, s.y.positions);
    const double w = matched.distance * matched.distance;
    const double bound = gw_lower_bound(s.c1, s.c2, s.a, s.b).best;
    for (const double alpha : {0.0, 0.25, 0.5, 1.0}) {
      const double cost = fused_gromov_wasserstein(features, s.c1, s.c2, s.a, s.b, alpha).cost;
      EXPECT_GE(cost, (1.0 - alpha) * w + alpha * bound * bound - 1e-9);
      EXPECT_LE(cost, (1.0 - alpha) * w + alpha * gw_cost(s.c1, s.c2, matched.plan) + 1e-9);
    }
  }
}

TEST(GromovWasserstein, RefusesWhatIsNotAMetric) {
  const VectorXd two = uniform_masses(2);
  MatrixXd good(2, 2), asymmetric(2, 2), negative(2, 2), diagonal(2, 2);
  good << 0, 1, 1, 0;
  asymmetric << 0, 1, 2, 0;
  negative << 0, -1, -1, 0;
  diagonal << 1, 1, 1, 1;
  for (const MatrixXd& bad : {asymmetric, negative, diagonal}) {
    EXPECT_THROW(gromov_wasserstein(bad, good, two, two), InputError);
    EXPECT_THROW(gromov_wasserstein(good, bad, two, two), InputError);
  }
  EXPECT_THROW(gromov_wasserstein(MatrixXd(0, 0), good, VectorXd(0), two), InputError);
  EXPECT_THROW(gromov_wasserstein(good, good, 2.0 * two, 2.0 * two), InputError);
  MatrixXd line(3, 3);
  line << 0, 1, 3, 1, 0, 2, 3, 2, 0;
  EXPECT_THROW(gromov_wasserstein(good, line, two, uniform_masses(3), {{"wrong", MatrixXd::Zero(2, 2)}}), InputError);
  EXPECT_THROW(fused_gromov_wasserstein(MatrixXd::Zero(2, 2), good, good, two, two, 1.5), InputError);
}

}  // namespace

}  // namespace anigen::metrics
