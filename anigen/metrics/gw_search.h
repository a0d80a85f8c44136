#pragma once
#include <Eigen/Core>
#include <vector>

#include "anigen/core/random.h"
#include "anigen/metrics/gromov_wasserstein.h"
#include "anigen/metrics/gw_problem.h"
#include "anigen/metrics/wasserstein.h"

namespace anigen::metrics {

/// A local minimum of a GwProblem.
struct GwPoint {
  std::vector<PlanCell> cells;  ///< masses in units
  double objective = 0.0;
  RowMatrix gradient;  ///< there
};

/// Local search on a GwProblem: conditional gradient with exact line search (a transport problem per step), then
/// exchanges of mass between two cells, (i,p), (j,q) -> (i,q), (j,p), in turns until neither improves.
///
/// An exchange is judged in constant time from the gradient D: with E = (e_i - e_j)(e_q - e_p)^T and delta units
/// moved, the objective changes by delta <D, E> - 4 curvature delta^2 C1_ij C2_pq, and D by the rank-one matrix
/// -2 curvature delta (C1_i - C1_j)(C2_q - C2_p)^T.
class GwDescent {
 public:
  explicit GwDescent(const GwProblem& problem);

  /// Descends from a coupling. @param start masses in units, row and column sums those of the problem
  GwPoint from(const std::vector<PlanCell>& start);
  /// Does `exchanges` random exchanges from a point, then descends by further exchanges of the rows they touched.
  /// @return the objective reached, at current()
  double perturb(const GwPoint& start, int exchanges, Rng& rng);
  GwPoint current() const { return {cells_, problem_.objective(cells_, gradient_), gradient_}; }
  /// Conditional gradient alone. @return iterations done
  int conditional_gradient(std::vector<PlanCell>& cells, int max_iterations);

 private:
  void set(const std::vector<PlanCell>& cells, const RowMatrix& gradient);
  bool exchange_waiting_rows();
  bool exchange_with_best_partner(std::size_t e);
  void exchange(std::size_t e, std::size_t f);
  void add(int row, int column, double mass);

  const GwProblem& problem_;
  double resolution_;
  TransportSolver linear_program_;
  std::vector<PlanCell> cells_;
  std::vector<int> index_;     // cell at (row, column), or -1
  std::vector<char> waiting_;  // rows whose cells may have found new partners
  RowMatrix gradient_;
  std::vector<double> step_;
};

/// The search that gromov_wasserstein and fused_gromov_wasserstein share: minimises
///   (1 - alpha) <features, plan> + alpha sum (d1 - d2)^2 plan plan.
struct GwSearch {
  const Eigen::MatrixXd &c1, &c2;
  const Eigen::VectorXd &a, &b;
  const Eigen::MatrixXd* features = nullptr;  ///< [n,m], or null for none
  double alpha = 1.0;
  const std::vector<GwStart>& starts;
  const GromovWassersteinOptions& options;

  /// @throws InputError for matrices that are not distances, masses that do not sum to 1, starts of the wrong shape
  GromovWasserstein run() const;
};

}  // namespace anigen::metrics
