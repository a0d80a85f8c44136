#pragma once
#include <Eigen/Core>
#include <optional>
#include <vector>

#include "anigen/eval/transport/mass_units.h"
#include "anigen/eval/transport/metric_tree.h"
#include "anigen/eval/transport/transport_plan.h"

namespace anigen::eval {

/// The quadratic program behind (fused) Gromov–Wasserstein, in whole units of mass:
///   objective(X) = <linear, X> - curvature * <C1 X C2, X>,
/// minimised over X >= 0 with row sums `supplies` and column sums `demands`. For square loss
///   cost(X / total) = constant + objective(X) / total,
/// since the squares of the distances meet only the marginals (Peyré, Cuturi and Solomon 2016, proposition 1). For
/// tree metrics the objective is concave, so vertices are optimal.
struct GwProblem {
  RowMatrix c1, c2;                        ///< [n,n], [m,m] symmetric, zero diagonal
  std::optional<MetricTree> tree1, tree2;  ///< when the matrices are tree geodesics: products take O(n m)
  MassUnits units;
  RowMatrix linear;        ///< [n,m], or empty for zero
  double curvature = 0.0;  ///< 2 alpha / total, alpha = 1 without a linear part

  int rows() const { return static_cast<int>(c1.rows()); }
  int columns() const { return static_cast<int>(c2.rows()); }

  /// linear - 2 curvature C1 X C2. [n,m]
  RowMatrix gradient(const std::vector<PlanCell>& cells) const;
  /// <linear, X> + <gradient(X), X>, halved.
  double objective(const std::vector<PlanCell>& cells, const RowMatrix& gradient) const;
  double objective(const std::vector<PlanCell>& cells) const { return objective(cells, gradient(cells)); }
  /// Whether a coupling has few enough cells (a vertex has n + m - 1 at most) for work on all pairs of them.
  bool sparse(std::size_t cells) const { return cells <= 4 * static_cast<std::size_t>(rows() + columns()); }
  /// Changes of the objective below this are rounding.
  double resolution() const;
};

/// sum over pairs of cells of (C1 - C2)^2 X X, summed directly: never negative, and exactly 0 for an isometry.
/// Costs the square of the number of cells. @param cells with masses that sum to 1
double gw_cost(const RowMatrix& c1, const RowMatrix& c2, const std::vector<PlanCell>& cells);

/// The same for a dense coupling, by three matrix products; rounding may leave a tiny negative number, which is
/// returned as 0. @param plan [n,m]
double gw_cost(const Eigen::MatrixXd& c1, const Eigen::MatrixXd& c2, const Eigen::MatrixXd& plan);

}  // namespace anigen::eval
