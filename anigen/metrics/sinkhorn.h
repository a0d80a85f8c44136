#pragma once
#include <Eigen/Core>

#include "anigen/metrics/transport_plan.h"

namespace anigen::metrics::kernels {

/// Row operations of the transport solvers, thousands of times per pair of skeletons; rows have some tens of
/// values. Compiled for wider vectors too; every form of kernels gives the same bits.

/// distance[j] = min(distance[j], costs[j] - potential[j] - offset), previous[j] = number where that was less.
/// @return the least distance
double relax(const double* costs, const double* potential, double offset, double number, double* distance,
             double* previous, int n);

double least(const double* values, int n);

/// values[i, k] += levers[i] · step[k] of a matrix of n rows and m columns that lie one after the other
void add_outer(const double* levers, const double* step, double* values, int n, int m);

}  // namespace anigen::metrics::kernels

namespace anigen::metrics {

/// Settings of sinkhorn(). The defaults are those of docs/reference/training.md, 7.3.
struct SinkhornOptions {
  double epsilon = 1e-3;        ///< final regularisation, as a share of the largest cost unless `absolute`
  double start_epsilon = 1e-1;  ///< annealing starts here (same unit) and quarters; not used when below `epsilon`
  bool absolute = false;        ///< both are in the unit of the cost
  double tolerance = 1e-6;      ///< stop when the row masses are right within this, L1, total mass 1
  int max_iterations = 2000;    ///< of the last epsilon; every earlier one gets at most 100
  bool round = true;            ///< repair the marginals (Altschuler et al. 2017, algorithm 2)
};

/// Result of sinkhorn().
struct SinkhornResult {
  Eigen::MatrixXd plan;         ///< [n,m]; feasible when rounded
  double cost = 0.0;            ///< <plan, cost>, without the entropy term
  double lower_bound = 0.0;     ///< value of feasible dual potentials: no coupling is cheaper
  double marginal_error = 0.0;  ///< L1 of the row masses before rounding
  int iterations = 0;           ///< at the last epsilon
  bool converged = false;       ///< marginal_error reached the tolerance
  Eigen::VectorXd row_potential,
      column_potential;  ///< [n], [m]: plan = exp((row + column - cost) / epsilon) before rounding

  /// Certified when rounded: the cost exceeds the optimum by at most this.
  double gap() const { return cost - lower_bound; }
};

/// Entropic transport, min <plan, cost> + epsilon * sum plan log plan, by Sinkhorn's alternating projections in the
/// log domain with epsilon scaling: potentials are kept as logarithms and the scaling factors between two
/// absorptions stay within e^(+-30) (Schmitzer 2019), which equals the log-sum-exp iteration at the price of two
/// matrix-vector products.
/// @param cost [n,m], @param a [n], @param b [m]  nonnegative, of equal sums  @throws InputError as check_transport, or
/// for settings that are not positive
SinkhornResult sinkhorn(const Eigen::MatrixXd& cost, const Eigen::VectorXd& a, const Eigen::VectorXd& b,
                        const SinkhornOptions& options = {});

/// The nearest coupling that Altschuler's rounding gives: rows and columns that carry too much are scaled down, what is
/// missing is added as a product. @param plan [n,m] nonnegative
Eigen::MatrixXd round_to_coupling(const Eigen::MatrixXd& plan, const Eigen::VectorXd& a, const Eigen::VectorXd& b);

}  // namespace anigen::metrics
