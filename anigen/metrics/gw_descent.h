#pragma once
#include <cstddef>
#include <functional>
#include <vector>

#include "anigen/core/random.h"
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
  /// @param problem outlives the descent
  explicit GwDescent(const GwProblem& problem);

  /// Descends from a coupling. @param start masses in units, row and column sums those of the problem
  GwPoint from(const std::vector<PlanCell>& start);

  /// Does `exchanges` random exchanges from a point, then descends by further exchanges of the rows they touched.
  /// @return the objective reached, at current()
  double perturb(const GwPoint& start, int exchanges, Rng& rng);

  /// Exchanges the partners of two neighbourhoods of a random size, or turns those of one round, then descends as
  /// perturb() does: a limb that is matched to a wrong one is too many exchanges away for these alone. Neighbourhoods
  /// are the points nearest to two random ones, on either side; of some that are drawn, those whose exchange costs
  /// least. @pre equal masses
  double perturb_neighbourhoods(const GwPoint& start, Rng& rng);

  /// Exchanges the partners of two branches of about one size in one of the trees, joint by joint, then descends as
  /// perturb() does: equal limbs are found in one step. @pre equal masses; both metrics are trees, numbered in preorder
  double perturb_branches(const GwPoint& start, Rng& rng);

  GwPoint current() const { return {cells_, problem_.objective(cells_, gradient_), gradient_}; }

  /// Conditional gradient alone. @return iterations done
  int conditional_gradient(std::vector<PlanCell>& cells, int max_iterations);

 private:
  void set(const std::vector<PlanCell>& cells, const RowMatrix& gradient);
  bool exchange_waiting_rows();
  bool exchange_with_best_partner(std::size_t e);
  void exchange(std::size_t e, std::size_t f);
  void add(int row, int column, double mass);
  void move_rows(const std::vector<int>& from, const std::vector<int>& to);
  void move_columns(const std::vector<int>& from, const std::vector<int>& to);
  std::size_t near_cell(std::size_t e, Rng& rng);
  // Rows, or else columns, from[k] that give their cells to to[k].
  struct PartnerSwap {
    bool rows = true;
    std::vector<int> from, to;
    void add(int one, int other) {
      from.insert(from.end(), {one, other});
      to.insert(to.end(), {other, one});
    }
  };
  PartnerSwap turned_neighbourhood(bool rows, std::size_t centre, std::size_t size);
  PartnerSwap two_neighbourhoods(bool rows, std::size_t one, std::size_t other, std::size_t size);
  double after_best_swap(const GwPoint& start, const std::function<PartnerSwap()>& drawn);
  double change_by(const PartnerSwap& swap);
  const std::vector<int>& by_distance(bool rows, std::size_t point);

  const GwProblem& problem_;
  double resolution_;
  TransportSolver linear_program_;
  std::vector<PlanCell> cells_;
  std::vector<int> index_;     // cell at (row, column), or -1
  std::vector<char> waiting_;  // rows whose cells may have found new partners
  RowMatrix gradient_;
  std::vector<double> lever_, step_;
  std::vector<int> goes_;
  std::vector<std::vector<int>> nearest_rows_, nearest_columns_;  // of each point, itself first; filled when needed
  std::vector<int> branch_rows_, branch_columns_;                 // joints of the branch that begins at each; likewise
};

}  // namespace anigen::metrics
