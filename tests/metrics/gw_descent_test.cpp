#include "anigen/metrics/gw_descent.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <limits>

#include "anigen/core/numeric.h"
#include "anigen/metrics/gromov_wasserstein.h"
#include "anigen/metrics/gw_starts.h"
#include "tests/metrics/transport_trees.h"

namespace anigen::metrics {
namespace {

GwProblem descent_problem(const Eigen::MatrixXd& c1, const Eigen::MatrixXd& c2) {
  GwProblem problem;
  problem.c1 = c1;
  problem.c2 = c2;
  problem.tree1 = metric_tree(c1);
  problem.tree2 = metric_tree(c2);
  problem.units = mass_units(uniform_masses(at(c1.rows())), uniform_masses(at(c2.rows())));
  problem.curvature = 2.0 / static_cast<double>(problem.units.total);
  return problem;
}

/// Distances along a ring of random edges, of length 1.
Eigen::MatrixXd random_ring(std::size_t points, Rng& rng) {
  std::vector<double> places(points);
  double length = 0.0;
  for (double& place : places) place = length, length += rng.uniform(0.2, 1.0);
  return matrix_of(points, points, [&](std::size_t i, std::size_t k) {
    const double along = std::abs(places[i] - places[k]);
    return std::min(along, length - along) / length;
  });
}

void expect_exact(const GwProblem& problem, const GwPoint& point, double reached) {
  std::vector<double> rows(at(problem.rows())), columns(at(problem.columns()));
  for (const PlanCell& cell : point.cells) rows[at(cell.row)] += cell.mass, columns[at(cell.column)] += cell.mass;
  for (std::size_t i = 0; i < rows.size(); ++i) EXPECT_EQ(rows[i], static_cast<double>(problem.units.supplies[i]));
  for (std::size_t k = 0; k < columns.size(); ++k) EXPECT_EQ(columns[k], static_cast<double>(problem.units.demands[k]));
  // The gradient that was carried along is that of the coupling.
  const RowMatrix exact = problem.gradient(point.cells);
  EXPECT_LT((point.gradient - exact).cwiseAbs().maxCoeff(), 1e-9 * (1.0 + exact.cwiseAbs().maxCoeff()));
  EXPECT_NEAR(reached, problem.objective(point.cells), 1e-9 * (1.0 + std::abs(reached)));
}

TEST(GwDescent, NeighbourhoodsExchangePartnersAndNothingElse) {
  Rng rng(7, "gw_descent_test");
  for (int trial = 0; trial < 60; ++trial) {
    const GwProblem problem = descent_problem(tree_geodesics(test::random_tree(5 + rng.index(25), rng)),
                                              tree_geodesics(test::random_tree(5 + rng.index(25), rng)));
    GwDescent descent(problem);
    const GwPoint start = descent.from(sorted_starts(problem)[0].cells);
    expect_exact(problem, descent.current(), start.objective);
    const double reached = descent.perturb_neighbourhoods(start, rng);
    expect_exact(problem, descent.current(), reached);
  }
}

// A tree in preorder, by way of the tree of its distances.
MetricTree preorder_tree(std::size_t joints, Rng& rng) {
  const MetricTree tree = *metric_tree(tree_geodesics(test::random_tree(joints, rng)));
  const Eigen::VectorXd masses = uniform_masses(joints);
  return canonical_order({tree, masses, {}}, {tree, masses, {}}).first_tree;
}

TEST(GwDescent, BranchesExchangePartnersAndNothingElse) {
  Rng rng(8, "gw_descent_test");
  int changed = 0;
  for (int trial = 0; trial < 60; ++trial) {
    const MetricTree one = preorder_tree(2 + rng.index(25), rng), other = preorder_tree(2 + rng.index(25), rng);
    GwProblem problem = descent_problem(path_lengths(one), path_lengths(other));
    problem.tree1 = one;
    problem.tree2 = other;
    GwDescent descent(problem);
    const GwPoint start = descent.from(sorted_starts(problem)[0].cells);
    const double reached = descent.perturb_branches(start, rng);
    expect_exact(problem, descent.current(), reached);
    changed += reached != start.objective ? 1 : 0;
  }
  EXPECT_GT(changed, 10);
}

TEST(GwStarts, ATurnedAndMirroredRingIsFound) {
  Rng rng(3, "gw_descent_test");
  for (const std::size_t points : {4, 7, 20, 61, 110}) {
    const Eigen::MatrixXd ring = random_ring(points, rng);
    const std::size_t turn = rng.index(points);
    const Eigen::MatrixXd other = matrix_of(points, points, [&](std::size_t i, std::size_t k) {
      return ring(static_cast<Eigen::Index>((2 * points - i + turn) % points),
                  static_cast<Eigen::Index>((2 * points - k + turn) % points));
    });
    const Eigen::VectorXd masses = uniform_masses(points);
    EXPECT_LT(gromov_wasserstein(ring, other, masses, masses).value, 1e-7) << points;
  }
}

// Cost of the monotone coupling of two rings whose points are numbered along them, with the second turned by so many
// units of mass: plainly, unit by unit.
double turned_cost(const GwProblem& problem, std::size_t turn, bool reversed) {
  const std::size_t total = static_cast<std::size_t>(problem.units.total);
  const std::size_t n = at(problem.rows()), m = at(problem.columns());
  RowMatrix plan = RowMatrix::Zero(problem.rows(), problem.columns());
  for (std::size_t unit = 0; unit < total; ++unit) {
    const std::size_t row = unit * n / total, column = ((unit + turn) % total) * m / total;
    plan(static_cast<Eigen::Index>(row), static_cast<Eigen::Index>(reversed ? m - 1 - column : column)) +=
        1.0 / static_cast<double>(total);
  }
  return gw_cost(problem.c1, problem.c2, plan);
}

TEST(GwStarts, NoTurnOfTwoRingsIsCheaperThanWhatIsFound) {
  Rng rng(5, "gw_descent_test");
  for (int trial = 0; trial < 12; ++trial) {
    const Eigen::MatrixXd one = random_ring(8 + rng.index(12), rng), other = random_ring(8 + rng.index(12), rng);
    const GwProblem problem = descent_problem(one, other);
    double least = std::numeric_limits<double>::infinity();
    for (std::size_t turn = 0; turn < static_cast<std::size_t>(problem.units.total); ++turn)
      least = std::min({least, turned_cost(problem, turn, false), turned_cost(problem, turn, true)});
    const double found =
        gromov_wasserstein(one, other, uniform_masses(at(one.rows())), uniform_masses(at(other.rows()))).cost;
    EXPECT_LE(found, least * (1.0 + 1e-9)) << one.rows() << " x " << other.rows();
  }
}

// 250,500 units of mass: trying each around the best turns would take half a minute.
TEST(GwStarts, TurnsOfLargeRingsAreNotAllTried) {
  Rng rng(6, "gw_descent_test");
  const GwProblem problem = descent_problem(random_ring(500, rng), random_ring(501, rng));
  const auto began = std::chrono::steady_clock::now();
  EXPECT_FALSE(cyclic_starts(problem).empty());
  EXPECT_LT(std::chrono::duration<double>(std::chrono::steady_clock::now() - began).count(), 15.0);
}

TEST(GwStarts, TurnsAreCouplings) {
  Rng rng(4, "gw_descent_test");
  for (int trial = 0; trial < 20; ++trial) {
    const GwProblem problem = descent_problem(random_ring(4 + rng.index(30), rng), random_ring(4 + rng.index(30), rng));
    const std::vector<GwSparseStart> starts = cyclic_starts(problem);
    ASSERT_FALSE(starts.empty());
    for (const GwSparseStart& start : starts) {
      std::vector<double> rows(at(problem.rows())), columns(at(problem.columns()));
      for (const PlanCell& cell : start.cells) {
        EXPECT_GT(cell.mass, 0.0);
        rows[at(cell.row)] += cell.mass, columns[at(cell.column)] += cell.mass;
      }
      for (std::size_t i = 0; i < rows.size(); ++i) EXPECT_EQ(rows[i], static_cast<double>(problem.units.supplies[i]));
      for (std::size_t k = 0; k < columns.size(); ++k)
        EXPECT_EQ(columns[k], static_cast<double>(problem.units.demands[k]));
    }
  }
}

}  // namespace
}  // namespace anigen::metrics
