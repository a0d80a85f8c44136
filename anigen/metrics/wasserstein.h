#pragma once
#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "anigen/metrics/sinkhorn.h"
#include "anigen/metrics/transport_plan.h"

namespace anigen::metrics {

/// Indices that sort `values` upwards; equal values keep their order.
std::vector<int> ascending(const Eigen::VectorXd& values);
/// result[k] = values[order[k]]
Eigen::VectorXd picked(const Eigen::VectorXd& values, const std::vector<int>& order);

/// The coupling that gives the first rows in `row_order` to the first columns in `column_order`: optimal between points
/// on a line for any convex cost when both orders go upwards. Masses in units.
std::vector<PlanCell> monotone_coupling(const MassUnits& units, const std::vector<int>& row_order,
                                        const std::vector<int>& column_order);

/// Squared Wasserstein-2 distance of two distributions on a line.
/// @param x, y sorted upwards @param a, b their masses, of equal sums
double line_cost(const Eigen::VectorXd& x, const Eigen::VectorXd& a, const Eigen::VectorXd& y,
                 const Eigen::VectorXd& b);

enum class ExactSolver {
  kAutomatic,       ///< whichever is the quicker one for these sizes: TransportSolver
  kShortestPaths,   ///< ours, quick for equal and for small sizes
  kNetworkSimplex,  ///< LEMON's, the oracle
};

/// The cheapest coupling of masses a and b, min <plan, cost>, exact up to the rounding of double precision. The plan is
/// a vertex (at most n + m - 1 positive entries); where several are optimal it is one of them.
/// @param cost [n,m], @param a [n], @param b [m]  nonnegative, of equal sums  @throws InputError as check_transport
TransportPlan exact_transport(const Eigen::MatrixXd& cost, const Eigen::VectorXd& a, const Eigen::VectorXd& b,
                              ExactSolver solver = ExactSolver::kAutomatic);

/// Exact transport between whole-number masses by successive shortest augmenting paths (Jonker and Volgenant 1987,
/// extended from assignments to supplies and demands). Meant to be kept and asked again: the potentials of one
/// problem start the next, which is what the linear programs inside Gromov–Wasserstein need.
class ShortestPathTransport {
 public:
  explicit ShortestPathTransport(const MassUnits& units);

  /// Minimises the sum of units * cost. @param cost [n,m] finite
  /// @return the cells of an optimal plan, masses in units, sorted by row then column
  const std::vector<PlanCell>& solve(const RowMatrix& cost);

  /// Dual value of the last solve, sum of supply * u + demand * v for feasible potentials (u_i + v_j <= cost_ij): a
  /// bound from below of every plan's cost that rounding cannot spoil by more than a few ulp.
  double dual_value() const { return dual_; }

 private:
  struct Flow {
    int row;
    std::int64_t units;
  };
  struct Settled {
    int column;
    double distance;
  };
  void run(const RowMatrix& cost);
  void reduce_columns(const RowMatrix& cost);
  void assign_tight(const RowMatrix& cost);
  void augment(const RowMatrix& cost, int source);
  double visit(const RowMatrix& cost, int row, double offset);
  bool push_along_path(int source, int sink);
  int previous_row(int column) const { return static_cast<int>(previous_row_[static_cast<std::size_t>(column)]); }
  void add_flow(int row, int column, std::int64_t units);

  bool transposed_;  // the shorter side is searched: it is the columns
  RowMatrix transposed_cost_;
  std::vector<std::int64_t> supplies_, demands_, supply_left_, demand_left_;
  int rows_, columns_;
  bool warm_ = false;
  std::vector<double> potential_;         // of columns
  std::vector<std::vector<Flow>> flows_;  // per column
  std::vector<double> open_distance_, open_potential_;
  std::vector<double> previous_row_;  // whole numbers, as doubles for the vector units
  std::vector<int> reached_from_;
  std::vector<Settled> settled_;
  std::vector<char> visited_;
  std::vector<PlanCell> cells_;
  double dual_ = 0.0;
};

/// |x_i - y_k|^2. @return [n,m]
Eigen::MatrixXd squared_distances(const std::vector<Eigen::Vector3d>& x, const std::vector<Eigen::Vector3d>& y);

/// A transport distance of two joint sets with equal masses 1/n and 1/m.
struct JointTransport {
  double distance = 0.0;  ///< in the unit of the positions
  Eigen::MatrixXd plan;   ///< [n,m], rows sum to 1/n, columns to 1/m
};

/// Wasserstein-2, exact: the root of min sum plan_ik |x_i - y_k|^2 (equation 7 of the paper).
/// @throws InputError when a set is empty or a position not finite
JointTransport wasserstein2(const std::vector<Eigen::Vector3d>& x, const std::vector<Eigen::Vector3d>& y,
                            ExactSolver solver = ExactSolver::kAutomatic);

/// Wasserstein-1, exact: min sum plan_ik |x_i - y_k|.
JointTransport wasserstein1(const std::vector<Eigen::Vector3d>& x, const std::vector<Eigen::Vector3d>& y,
                            ExactSolver solver = ExactSolver::kAutomatic);

/// Wasserstein-2 by Sinkhorn, the solver the paper names. The certified gap is one of squared distances:
/// exact^2 lies in [cost - gap, cost].
SinkhornResult sinkhorn_wasserstein2(const std::vector<Eigen::Vector3d>& x, const std::vector<Eigen::Vector3d>& y,
                                     const SinkhornOptions& options = {});

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

}  // namespace anigen::metrics
