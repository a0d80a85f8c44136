#include "anigen/eval/transport/gw_starts.h"

#include <algorithm>

#include "anigen/eval/transport/line_transport.h"
#include "anigen/eval/transport/transport_solver.h"

namespace anigen::eval {
namespace {

Eigen::VectorXd masses(const std::vector<std::int64_t>& units) {
  Eigen::VectorXd result(static_cast<Eigen::Index>(units.size()));
  for (std::size_t i = 0; i < units.size(); ++i) result[static_cast<Eigen::Index>(i)] = static_cast<double>(units[i]);
  return result;
}

// Distance to one end of the longest path minus distance to the other.
Eigen::VectorXd along_diameter(const RowMatrix& c) {
  Eigen::Index one = 0, two = 0;
  c.maxCoeff(&one, &two);
  return c.col(one) - c.col(two);
}

}  // namespace

std::vector<GwSparseStart> sorted_starts(const GwProblem& problem) {
  const MassUnits& units = problem.units;
  const auto monotone = [&](const Eigen::VectorXd& rows, const Eigen::VectorXd& columns) {
    return monotone_coupling(units, ascending(rows), ascending(columns));
  };
  const Eigen::VectorXd path1 = along_diameter(problem.c1), path2 = along_diameter(problem.c2);
  return {{"product", monotone(problem.c1 * masses(units.supplies), problem.c2 * masses(units.demands))},
          {"eccentricity", monotone(problem.c1.rowwise().maxCoeff(), problem.c2.rowwise().maxCoeff())},
          {"diameter", monotone(path1, path2)},
          {"diameter reversed", monotone(path1, -path2)}};
}

GwSparseStart profile_start(const GwProblem& problem, const RowMatrix& costs) {
  TransportSolver transport(problem.units);
  return {"profiles", transport.solve(costs)};
}

}  // namespace anigen::eval
