#pragma once
#include <vector>

#include "anigen/eval/transport/mass_units.h"
#include "anigen/eval/transport/shortest_path_transport.h"

namespace anigen::eval {

/// Exact transport by whichever of the two solvers is the quicker one for these masses. Augmenting paths win as long as
/// supplies and demands are few units each: equal or nearly equal sizes, and anything small. Sizes such as 757 and 841
/// split every mass into hundreds of units; there the network simplex needs 0.3 s where augmenting paths need 14.
/// Like ShortestPathTransport meant to be kept and asked again; the simplex does not profit from that.
class TransportSolver {
 public:
  explicit TransportSolver(const MassUnits& units);

  /// Minimises the sum of units * cost. @param cost [n,m] finite
  /// @return the cells of an optimal plan, masses in units, sorted by row then column
  const std::vector<PlanCell>& solve(const RowMatrix& cost);

  /// A bound from below of every plan's cost, in units * cost: within rounding of the optimum.
  double lower_bound() const { return lower_bound_; }

 private:
  MassUnits units_;
  bool simplex_;
  ShortestPathTransport paths_;
  std::vector<PlanCell> cells_;
  double lower_bound_ = 0.0;
};

}  // namespace anigen::eval
