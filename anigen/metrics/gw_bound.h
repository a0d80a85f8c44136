#pragma once
#include <Eigen/Core>
#include <string>
#include <vector>

#include "anigen/metrics/gw_problem.h"
#include "anigen/metrics/transport_plan.h"

namespace anigen::metrics {

/// Certified bounds from below of the Gromov–Wasserstein value, in the unit of the distances. All are lowered by the
/// rounding they may carry (1e-12 of the largest squared distance), so none is above the true value.
struct GwLowerBound {
  double global_distances = 0.0;  ///< second lower bound of Mémoli 2011: all distances as one distribution on a line
  double local_distances = 0.0;   ///< third lower bound: transport between joints, each a distribution of distances
  double spectral = 0.0;          ///< eigenvalue bound, see spectral_bound
  double best = 0.0;              ///< the largest
};

/// @param c1 [n,n], @param c2 [m,m]  symmetric, zero diagonal, @param a [n], @param b [m]  masses that sum to 1
GwLowerBound gw_lower_bound(const Eigen::MatrixXd& c1, const Eigen::MatrixXd& c2, const Eigen::VectorXd& a,
                            const Eigen::VectorXd& b);

/// Squared Wasserstein-2 distance on the line between the distances seen from i and from j: what matching i with j
/// costs at least. [n,m]; O(n m (n + m)), as a matrix product when the masses are equal.
RowMatrix profile_costs(const Eigen::MatrixXd& c1, const Eigen::MatrixXd& c2, const Eigen::VectorXd& a,
                        const Eigen::VectorXd& b);

}  // namespace anigen::metrics
