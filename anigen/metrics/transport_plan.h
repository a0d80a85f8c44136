#pragma once
#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace anigen::metrics {

/// Masses as whole numbers, so that flows are exact and an optimal plan is a true vertex. Equal masses 1/n and 1/m
/// become m/gcd(n,m) and n/gcd(n,m) units without any rounding; other masses are shares of 2^40 units, rounded by
/// largest remainders (relative error about 1e-12).
struct MassUnits {
  std::vector<std::int64_t> supplies, demands;  ///< [n], [m]; equal sums
  std::int64_t total = 0;                       ///< their sum: one unit is the share 1/total of the mass
  bool uniform = false;                         ///< both measures have equal masses
};

/// @param a [n], @param b [m]  checked by check_transport
MassUnits mass_units(const Eigen::VectorXd& a, const Eigen::VectorXd& b);

/// Row-major matrix: the solvers scan rows.
using RowMatrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

/// A coupling of two discrete measures and what it costs.
struct TransportPlan {
  Eigen::MatrixXd plan;  ///< [n,m], rows sum to a, columns to b
  double cost = 0.0;     ///< sum of plan * cost
};

/// One positive entry of a sparse coupling. Ordered by row, then column.
struct PlanCell {
  int row = 0, column = 0;
  double mass = 0.0;
  bool operator<(const PlanCell& other) const { return row != other.row ? row < other.row : column < other.column; }
};

/// The positive entries in row-major order.
std::vector<PlanCell> plan_cells(const Eigen::MatrixXd& plan);

/// value(i, k) for every i < rows and k < columns.
template <typename Value>
Eigen::MatrixXd matrix_of(std::size_t rows, std::size_t columns, const Value& value) {
  Eigen::MatrixXd result(static_cast<Eigen::Index>(rows), static_cast<Eigen::Index>(columns));
  for (std::size_t i = 0; i < rows; ++i) {
    for (std::size_t k = 0; k < columns; ++k)
      result(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(k)) = value(i, k);
  }
  return result;
}

/// Equal masses 1/n.
Eigen::VectorXd uniform_masses(std::size_t n);

/// @throws InputError: an empty matrix, lengths that differ from it, masses that are negative, not finite or of
/// different sums (relative 1e-9), a cost that is not finite
void check_transport(const Eigen::MatrixXd& cost, const Eigen::VectorXd& a, const Eigen::VectorXd& b);

}  // namespace anigen::metrics
