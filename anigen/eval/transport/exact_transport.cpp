#include "anigen/eval/transport/exact_transport.h"

#include "anigen/eval/transport/network_simplex_transport.h"
#include "anigen/eval/transport/shortest_path_transport.h"
#include "anigen/eval/transport/transport_solver.h"

namespace anigen::eval {

TransportPlan exact_transport(const Eigen::MatrixXd& cost, const Eigen::VectorXd& a, const Eigen::VectorXd& b,
                              ExactSolver solver) {
  if (solver == ExactSolver::kNetworkSimplex) return network_simplex_transport(cost, a, b);
  check_transport(cost, a, b);
  const MassUnits units = mass_units(a, b);
  const double unit = a.sum() / static_cast<double>(units.total);
  TransportPlan result{Eigen::MatrixXd::Zero(cost.rows(), cost.cols()), 0.0};
  const std::vector<PlanCell> cells = solver == ExactSolver::kShortestPaths ? ShortestPathTransport(units).solve(cost)
                                                                            : TransportSolver(units).solve(cost);
  for (const PlanCell& cell : cells) {
    result.plan(cell.row, cell.column) = cell.mass * unit;
    result.cost += cell.mass * cost(cell.row, cell.column);
  }
  result.cost *= unit;
  return result;
}

}  // namespace anigen::eval
