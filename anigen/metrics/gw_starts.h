#pragma once
#include <Eigen/Core>
#include <string>
#include <vector>

#include "anigen/metrics/gw_problem.h"

namespace anigen::metrics {

/// A place where the search for a Gromov–Wasserstein coupling begins.
struct GwStart {
  std::string name;
  Eigen::MatrixXd plan;  ///< [n,m] a coupling of the masses
};

/// As above, as sparse cells in units of the problem.
struct GwSparseStart {
  std::string name;
  std::vector<PlanCell> cells;
};

/// Starts made of the two metric spaces alone, each a monotone coupling of joints sorted by one number:
///   product        mean distance; exactly the vertex where conditional gradient goes from the product plan
///   eccentricity   largest distance
///   diameter       position between the two ends of the longest path, and the same reversed
std::vector<GwSparseStart> sorted_starts(const GwProblem& problem);

/// The coupling that the third lower bound attains ("profiles"): joints matched by their sorted distances to the
/// others. @param costs profile_costs of the problem's matrices
GwSparseStart profile_start(const GwProblem& problem, const RowMatrix& costs);

/// Starts for metrics that go round, such as rings: both spaces laid into a plane (classical multidimensional scaling),
/// points sorted by their angle there, and the monotone couplings of all turns of either side; the least costly few.
std::vector<GwSparseStart> cyclic_starts(const GwProblem& problem);

}  // namespace anigen::metrics
