// Entropic transport: the certificate holds, the plan is a coupling, the limit is the exact cost.
#include "anigen/metrics/sinkhorn.h"

#include <gtest/gtest.h>

#include "anigen/core/error.h"
#include "anigen/metrics/wasserstein.h"
#include "tests/metrics/transport_trees.h"

namespace anigen::metrics {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

struct Problem {
  MatrixXd cost;
  VectorXd a, b;
};

Problem random_problem(std::uint64_t seed) {
  Rng rng(seed, "test");
  const std::size_t n = 1 + rng.index(25), m = 1 + rng.index(25);
  return {test::random_matrix(n, m, rng), test::random_masses(n, rng), test::random_masses(m, rng)};
}

TEST(Sinkhorn, CertifiedGapHoldsHoweverEarlyItStops) {
  for (std::uint64_t seed = 0; seed < 20; ++seed) {
    const Problem problem = random_problem(seed);
    const double exact = exact_transport(problem.cost, problem.a, problem.b).cost;
    for (const int iterations : {1, 5, 2000}) {
      SinkhornOptions options;
      options.max_iterations = iterations;
      const SinkhornResult found = sinkhorn(problem.cost, problem.a, problem.b, options);
      EXPECT_LT(test::marginal_error(found.plan, problem.a, problem.b), 1e-12);
      EXPECT_GE(found.plan.minCoeff(), 0.0);
      EXPECT_LE(found.lower_bound, exact + 1e-11);
      EXPECT_GE(found.cost, exact - 1e-11);
      EXPECT_LE(found.cost - exact, found.gap() + 1e-11);
    }
  }
}

TEST(Sinkhorn, DefaultIsWithinAPercentOfTheCostRange) {
  for (std::uint64_t seed = 0; seed < 10; ++seed) {
    const Problem problem = random_problem(seed);
    const SinkhornResult found = sinkhorn(problem.cost, problem.a, problem.b);
    EXPECT_LT(found.gap(), 0.01 * problem.cost.maxCoeff());
  }
}

TEST(Sinkhorn, SmallerEpsilonComesNearer) {
  const Problem problem = random_problem(3);
  double last = 1.0;
  for (const double epsilon : {1e-1, 1e-2, 1e-3}) {
    SinkhornOptions options;
    options.epsilon = epsilon;
    options.max_iterations = 20000;
    const double gap = sinkhorn(problem.cost, problem.a, problem.b, options).gap();
    EXPECT_LT(gap, 0.5 * last);
    last = gap;
  }
}

TEST(Sinkhorn, EntropicPlanHasTheOptimalForm) {
  // The minimiser is exp((f_i + g_j - cost) / epsilon) with the right marginals, and only that one.
  const Problem problem = random_problem(5);
  SinkhornOptions options;
  options.epsilon = 0.05;
  options.absolute = true;
  options.tolerance = 1e-13;
  options.max_iterations = 20000;
  options.round = false;
  const SinkhornResult found = sinkhorn(problem.cost, problem.a, problem.b, options);
  EXPECT_TRUE(found.converged);
  EXPECT_LT(test::marginal_error(found.plan, problem.a, problem.b), 1e-12);
  for (Eigen::Index i = 0; i < problem.a.size(); ++i) {
    for (Eigen::Index k = 0; k < problem.b.size(); ++k) {
      const double exponent = (found.row_potential[i] + found.column_potential[k] - problem.cost(i, k)) / 0.05;
      EXPECT_NEAR(found.plan(i, k), std::exp(exponent), 1e-12);
    }
  }
}

TEST(Sinkhorn, TinyEpsilonDoesNotOverflow) {
  Rng rng(0, "test");
  const MatrixXd cost = 1e3 * test::random_matrix(8, 11, rng);
  SinkhornOptions options;
  options.epsilon = 1e-6;
  const SinkhornResult found = sinkhorn(cost, uniform_masses(8), uniform_masses(11), options);
  EXPECT_TRUE(found.plan.allFinite());
  EXPECT_LE(found.lower_bound, exact_transport(cost, uniform_masses(8), uniform_masses(11)).cost + 1e-9);
}

TEST(Sinkhorn, PointsWithoutMassAndWithoutDistance) {
  VectorXd a(3);
  a << 0.5, 0.0, 0.5;
  MatrixXd cost(3, 2);
  cost << 0, 1, 5, 5, 1, 0;
  const SinkhornResult found = sinkhorn(cost, a, uniform_masses(2));
  EXPECT_TRUE(found.plan.allFinite());
  EXPECT_EQ(found.plan.row(1).sum(), 0.0);
  EXPECT_NEAR(found.cost, 0.0, 1e-2);

  const SinkhornResult nothing = sinkhorn(MatrixXd::Zero(3, 2), a, uniform_masses(2));
  EXPECT_EQ(nothing.cost, 0.0);
  EXPECT_LT(test::marginal_error(nothing.plan, a, uniform_masses(2)), 1e-12);
}

TEST(Sinkhorn, RefusesBadSettings) {
  const MatrixXd cost = MatrixXd::Zero(2, 2);
  SinkhornOptions options;
  options.epsilon = 0.0;
  EXPECT_THROW(sinkhorn(cost, uniform_masses(2), uniform_masses(2), options), InputError);
  options = {};
  options.max_iterations = 0;
  EXPECT_THROW(sinkhorn(cost, uniform_masses(2), uniform_masses(2), options), InputError);
}

TEST(RoundToCoupling, RepairsAnyPlan) {
  Rng rng(2, "test");
  const VectorXd a = test::random_masses(6, rng), b = test::random_masses(9, rng);
  const MatrixXd plan = 0.05 * test::random_matrix(6, 9, rng);
  EXPECT_LT(test::marginal_error(round_to_coupling(plan, a, b), a, b), 1e-14);
  const MatrixXd product = a * b.transpose();
  EXPECT_LT((round_to_coupling(product, a, b) - product).cwiseAbs().maxCoeff(), 1e-15);
}

}  // namespace
}  // namespace anigen::metrics
