#include "anigen/metrics/gw_descent.h"

#include <gtest/gtest.h>

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

TEST(GwDescent, NeighbourhoodsExchangePartnersAndNothingElse) {
  Rng rng(7, "gw_descent_test");
  for (int trial = 0; trial < 60; ++trial) {
    const GwProblem problem = descent_problem(tree_geodesics(test::random_tree(5 + rng.index(25), rng)),
                                              tree_geodesics(test::random_tree(5 + rng.index(25), rng)));
    GwDescent descent(problem);
    const GwPoint start = descent.from(sorted_starts(problem)[0].cells);
    const double reached = descent.perturb_neighbourhoods(start, rng);
    const GwPoint point = descent.current();
    std::vector<double> rows(at(problem.rows())), columns(at(problem.columns()));
    for (const PlanCell& cell : point.cells) rows[at(cell.row)] += cell.mass, columns[at(cell.column)] += cell.mass;
    for (std::size_t i = 0; i < rows.size(); ++i) EXPECT_EQ(rows[i], static_cast<double>(problem.units.supplies[i]));
    for (std::size_t k = 0; k < columns.size(); ++k)
      EXPECT_EQ(columns[k], static_cast<double>(problem.units.demands[k]));
    // The gradient that was carried along is that of the coupling.
    const RowMatrix exact = problem.gradient(point.cells);
    EXPECT_LT((point.gradient - exact).cwiseAbs().maxCoeff(), 1e-9 * (1.0 + exact.cwiseAbs().maxCoeff()));
    EXPECT_NEAR(reached, problem.objective(point.cells), 1e-9 * (1.0 + std::abs(reached)));
  }
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
