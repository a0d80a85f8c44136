// Exact transport: against enumeration, against LEMON, and on degenerate input.
#include "anigen/metrics/wasserstein.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <limits>
#include <numeric>

#include "anigen/core/error.h"
#include "anigen/core/random.h"
#include "anigen/metrics/transport_plan.h"
#include "tests/metrics/transport_trees.h"

namespace anigen::metrics {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr ExactSolver kSolvers[] = {ExactSolver::kShortestPaths, ExactSolver::kNetworkSimplex};

double cheapest_permutation(const MatrixXd& cost) {
  std::vector<int> order(static_cast<std::size_t>(cost.rows()));
  std::iota(order.begin(), order.end(), 0);
  double best = std::numeric_limits<double>::infinity();
  do {
    double sum = 0.0;
    for (Eigen::Index i = 0; i < cost.rows(); ++i) sum += cost(i, order[static_cast<std::size_t>(i)]);
    best = std::min(best, sum);
  } while (std::next_permutation(order.begin(), order.end()));
  return best / static_cast<double>(cost.rows());
}

// Equal masses 1/n and 1/m are an assignment of lcm/n copies of each row to lcm/m copies of each column.
double cheapest_by_copies(const MatrixXd& cost) {
  const Eigen::Index size = std::lcm(cost.rows(), cost.cols());
  MatrixXd copies(size, size);
  for (Eigen::Index i = 0; i < size; ++i) {
    for (Eigen::Index k = 0; k < size; ++k) copies(i, k) = cost(i % cost.rows(), k % cost.cols());
  }
  return cheapest_permutation(copies);
}

TEST(ExactTransport, EqualsEnumerationOfPermutations) {
  for (std::uint64_t seed = 0; seed < 20; ++seed) {
    Rng rng(seed, "test");
    const std::size_t n = 1 + rng.index(7);
    const MatrixXd cost = test::random_matrix(n, n, rng);
    const double best = cheapest_permutation(cost);
    for (const ExactSolver solver : kSolvers)
      EXPECT_NEAR(exact_transport(cost, uniform_masses(n), uniform_masses(n), solver).cost, best, 1e-12);
  }
}

TEST(ExactTransport, EqualsEnumerationOfCopiesWhenSizesDiffer) {
  for (const auto& [n, m] : {std::pair<std::size_t, std::size_t>{2, 4}, {4, 8}, {6, 2}, {6, 3}, {1, 5}, {2, 3}}) {
    Rng rng(n * 100 + m, "test");
    const MatrixXd cost = test::random_matrix(n, m, rng);
    const double best = cheapest_by_copies(cost);
    for (const ExactSolver solver : kSolvers)
      EXPECT_NEAR(exact_transport(cost, uniform_masses(n), uniform_masses(m), solver).cost, best, 1e-12);
  }
}

TEST(ExactTransport, SolversAgreeAndPlansAreVertices) {
  for (std::uint64_t seed = 0; seed < 30; ++seed) {
    Rng rng(seed, "test");
    const std::size_t n = 1 + rng.index(40), m = seed % 3 == 0 ? n : 1 + rng.index(40);
    const MatrixXd cost = test::random_matrix(n, m, rng);
    const bool equal = seed % 2 == 0;
    const VectorXd a = equal ? uniform_masses(n) : test::random_masses(n, rng);
    const VectorXd b = equal ? uniform_masses(m) : test::random_masses(m, rng);
    const TransportPlan ours = exact_transport(cost, a, b), theirs = exact_transport(cost, a, b, kSolvers[1]);
    EXPECT_NEAR(ours.cost, theirs.cost, 1e-9 * theirs.cost);
    for (const TransportPlan* found : {&ours, &theirs}) {
      // Other than equal masses are rounded to 2^-40.
      EXPECT_LT(test::marginal_error(found->plan, a, b), equal ? 1e-13 : 1e-10);
      EXPECT_GE(found->plan.minCoeff(), 0.0);
      EXPECT_LE(plan_cells(found->plan).size(), n + m - 1);
      EXPECT_NEAR(found->cost, (found->plan.array() * cost.array()).sum(), 1e-14);
    }
  }
}

TEST(ExactTransport, DualProvesOptimality) {
  for (std::uint64_t seed = 0; seed < 10; ++seed) {
    Rng rng(seed, "test");
    const std::size_t n = 5 + rng.index(30), m = 5 + rng.index(30);
    const MassUnits units = mass_units(uniform_masses(n), uniform_masses(m));
    ShortestPathTransport transport(units);
    // The second problem starts from the first one's potentials.
    for (int problem = 0; problem < 2; ++problem) {
      const RowMatrix cost = test::random_matrix(n, m, rng);
      double primal = 0.0;
      for (const PlanCell& cell : transport.solve(cost)) primal += cell.mass * cost(cell.row, cell.column);
      EXPECT_NEAR(primal, transport.dual_value(), 1e-10 * primal);
    }
  }
}

TEST(ExactTransport, ManyTies) {
  // Whole costs 0, 1, 2: nearly every potential ties.
  for (std::uint64_t seed = 0; seed < 20; ++seed) {
    Rng rng(seed, "test");
    const std::size_t n = 2 + rng.index(30), m = seed % 2 == 0 ? n : 2 + rng.index(30);
    MatrixXd cost(static_cast<Eigen::Index>(n), static_cast<Eigen::Index>(m));
    for (double& value : cost.reshaped()) value = static_cast<double>(rng.index(3));
    const VectorXd a = uniform_masses(n), b = uniform_masses(m);
    EXPECT_NEAR(exact_transport(cost, a, b).cost, exact_transport(cost, a, b, kSolvers[1]).cost, 1e-12);
  }
  EXPECT_EQ(exact_transport(MatrixXd::Zero(5, 3), uniform_masses(5), uniform_masses(3)).cost, 0.0);
}

TEST(ExactTransport, CostsFarBelowTheLargestStillCount) {
  // One huge entry must not hide the differences among the others.
  Rng rng(0, "test");
  MatrixXd cost = 1e-6 * test::random_matrix(6, 6, rng);
  cost(2, 3) = 1.0;
  const double best = cheapest_permutation(cost);
  for (const ExactSolver solver : kSolvers)
    EXPECT_NEAR(exact_transport(cost, uniform_masses(6), uniform_masses(6), solver).cost, best, 1e-9 * best);
}

TEST(ExactTransport, RefusesWhatIsNotTransport) {
  const VectorXd two = uniform_masses(2);
  EXPECT_THROW(exact_transport(MatrixXd(0, 0), VectorXd(0), VectorXd(0)), InputError);
  EXPECT_THROW(exact_transport(MatrixXd::Zero(2, 3), two, two), InputError);
  EXPECT_THROW(exact_transport(MatrixXd::Zero(2, 2), two, 2.0 * two), InputError);
  EXPECT_THROW(exact_transport(MatrixXd::Zero(2, 2), two, VectorXd(Eigen::Vector2d(1.5, -0.5))), InputError);
  MatrixXd bad = MatrixXd::Zero(2, 2);
  bad(1, 0) = std::numeric_limits<double>::quiet_NaN();
  for (const ExactSolver solver : kSolvers) EXPECT_THROW(exact_transport(bad, two, two, solver), InputError);
}

TEST(Wasserstein, TranslationCostsItsLength) {
  Rng rng(1, "test");
  const JointTree tree = test::random_tree(12, rng);
  std::vector<Eigen::Vector3d> moved = tree.positions;
  for (Eigen::Vector3d& p : moved) p += Eigen::Vector3d(0.3, -0.4, 1.2);
  EXPECT_NEAR(wasserstein2(tree.positions, moved).distance, 1.3, 1e-12);
  EXPECT_NEAR(wasserstein1(tree.positions, moved).distance, 1.3, 1e-12);
  EXPECT_EQ(wasserstein2(tree.positions, tree.positions).distance, 0.0);
}

TEST(Wasserstein, SingleJointSeesTheSpread) {
  const std::vector<Eigen::Vector3d> one = {{0, 0, 0}}, two = {{1, 0, 0}, {0, 2, 0}};
  EXPECT_NEAR(wasserstein2(one, two).distance, std::sqrt(2.5), 1e-15);
  EXPECT_NEAR(wasserstein1(one, two).distance, 1.5, 1e-15);
  EXPECT_THROW(wasserstein2(one, {}), InputError);
}

TEST(TransportSolver, AgreesWithBothSolversWhereItPicksTheSimplex) {
  // 160 x 190 joints split masses into 19 and 16 units; 160 x 161 stay with augmenting paths.
  for (const Eigen::Index m : {190, 161}) {
    Rng rng(7, "transport solver", static_cast<std::uint64_t>(m));
    Eigen::MatrixXd cost(160, m);
    for (Eigen::Index i = 0; i < cost.rows(); ++i) {
      for (Eigen::Index k = 0; k < m; ++k) cost(i, k) = rng.uniform();
    }
    const Eigen::VectorXd a = uniform_masses(160), b = uniform_masses(static_cast<std::size_t>(m));
    const double exact = exact_transport(cost, a, b, ExactSolver::kShortestPaths).cost;
    const TransportPlan plan = exact_transport(cost, a, b);
    EXPECT_NEAR(plan.cost, exact, 1e-10 * exact) << m;
    EXPECT_LT((plan.plan.rowwise().sum() - a).cwiseAbs().maxCoeff(), 1e-15);
    EXPECT_LT((plan.plan.colwise().sum().transpose() - b).cwiseAbs().maxCoeff(), 1e-15);

    const MassUnits units = mass_units(a, b);
    TransportSolver solver(units);
    double total = 0;
    for (const PlanCell& cell : solver.solve(cost)) total += cell.mass * cost(cell.row, cell.column);
    EXPECT_LE(solver.lower_bound(), total * (1 + 1e-14));
    EXPECT_NEAR(solver.lower_bound(), total, 1e-9 * total);
  }
}

}  // namespace
}  // namespace anigen::metrics
