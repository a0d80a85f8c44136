#pragma once
#include <cstdint>
#include <vector>

#include "anigen/eval/transport/mass_units.h"
#include "anigen/eval/transport/transport_plan.h"

namespace anigen::eval {

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
  double dual_value() const;

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

}  // namespace anigen::eval
