#include "anigen/eval/transport/transport_solver.h"

#include <algorithm>

#include "anigen/eval/transport/network_simplex_transport.h"

namespace anigen::eval {
namespace {

/// Below this many cells augmenting paths take milliseconds whatever the masses are.
constexpr std::size_t kFewCells = 20000;
/// Sizes closer than this leave almost every mass whole: 842 and 841 joints exchange but a share of 1/841 each.
constexpr double kNearlyEqual = 0.02;

bool suits_simplex(const MassUnits& units) {
  const std::size_t n = units.supplies.size(), m = units.demands.size();
  if (n * m < kFewCells) return false;
  const double larger = static_cast<double>(std::max(n, m)), smaller = static_cast<double>(std::min(n, m));
  // A multiple of the other size leaves one side with single units.
  const bool few_units = *std::max_element(units.supplies.begin(), units.supplies.end()) <= 4 ||
                         *std::max_element(units.demands.begin(), units.demands.end()) <= 4;
  return !few_units && larger > (1.0 + kNearlyEqual) * smaller;
}

}  // namespace

TransportSolver::TransportSolver(const MassUnits& units)
    : units_(units), simplex_(suits_simplex(units)), paths_(units) {}

const std::vector<PlanCell>& TransportSolver::solve(const RowMatrix& cost) {
  if (!simplex_) {
    const std::vector<PlanCell>& cells = paths_.solve(cost);
    lower_bound_ = paths_.dual_value();
    return cells;
  }
  double rounding = 0.0;
  cells_ = network_simplex_cells(cost, units_, rounding);
  lower_bound_ = -rounding;
  for (const PlanCell& cell : cells_) lower_bound_ += cell.mass * cost(cell.row, cell.column);
  return cells_;
}

}  // namespace anigen::eval
