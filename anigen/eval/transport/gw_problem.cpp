#include "anigen/eval/transport/gw_problem.h"

#include <algorithm>

namespace anigen::eval {

RowMatrix GwProblem::gradient(const std::vector<PlanCell>& cells) const {
  RowMatrix moved = RowMatrix::Zero(rows(), columns());
  for (const PlanCell& cell : cells) moved.row(cell.row) += cell.mass * c2.row(cell.column);
  RowMatrix result = tree1 ? multiply(*tree1, moved) : RowMatrix(c1 * moved);
  result *= -2.0 * curvature;
  if (linear.size() > 0) result += linear;
  return result;
}

double GwProblem::objective(const std::vector<PlanCell>& cells, const RowMatrix& gradient) const {
  double sum = 0.0;
  for (const PlanCell& cell : cells) {
    sum += cell.mass * (gradient(cell.row, cell.column) + (linear.size() > 0 ? linear(cell.row, cell.column) : 0.0));
  }
  return 0.5 * sum;
}

double GwProblem::resolution() const {
  const double total = static_cast<double>(units.total);
  const double quadratic = curvature * total * c1.maxCoeff() * c2.maxCoeff();
  const double largest = linear.size() > 0 ? linear.cwiseAbs().maxCoeff() : 0.0;
  return 1e-12 * total * (quadratic + largest);
}

double gw_cost(const RowMatrix& c1, const RowMatrix& c2, const std::vector<PlanCell>& cells) {
  double sum = 0.0;
  for (std::size_t e = 0; e < cells.size(); ++e) {
    const double* d1 = c1.row(cells[e].row).data();
    const double* d2 = c2.row(cells[e].column).data();
    double inner = 0.0;
    for (std::size_t f = 0; f < e; ++f) {
      const double difference = d1[cells[f].row] - d2[cells[f].column];
      inner += cells[f].mass * difference * difference;
    }
    sum += 2.0 * cells[e].mass * inner;
  }
  return sum;
}

double gw_cost(const Eigen::MatrixXd& c1, const Eigen::MatrixXd& c2, const Eigen::MatrixXd& plan) {
  const Eigen::VectorXd rows = plan.rowwise().sum(), columns = plan.colwise().sum();
  const double squares = rows.dot(c1.cwiseAbs2() * rows) + columns.dot(c2.cwiseAbs2() * columns);
  return std::max(0.0, squares - 2.0 * (c1 * plan * c2).cwiseProduct(plan).sum());
}

}  // namespace anigen::eval
