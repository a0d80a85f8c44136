#pragma once
#include <Eigen/Core>
#include <vector>

namespace anigen::eval {

/// Row-major matrix: the solvers scan rows.
using RowMatrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

/// A coupling of two discrete measures and what it costs.
struct TransportPlan {
  Eigen::MatrixXd plan;  ///< [n,m], rows sum to a, columns to b
  double cost = 0.0;     ///< sum of plan * cost
};

/// One positive entry of a sparse coupling.
struct PlanCell {
  int row = 0, column = 0;
  double mass = 0.0;
};

/// The positive entries in row-major order.
std::vector<PlanCell> plan_cells(const Eigen::MatrixXd& plan);

/// Equal masses 1/n.
Eigen::VectorXd uniform_masses(std::size_t n);

/// @throws InputError: an empty matrix, lengths that differ from it, masses that are negative, not finite or of
/// different sums (relative 1e-9), a cost that is not finite
void check_transport(const Eigen::MatrixXd& cost, const Eigen::VectorXd& a, const Eigen::VectorXd& b);

}  // namespace anigen::eval
