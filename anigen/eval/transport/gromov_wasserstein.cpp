#include "anigen/eval/transport/gromov_wasserstein.h"

#include <algorithm>

#include "anigen/eval/transport/gw_descent.h"
#include "anigen/eval/transport/gw_search.h"

namespace anigen::eval {

GromovWasserstein gromov_wasserstein(const Eigen::MatrixXd& c1, const Eigen::MatrixXd& c2, const Eigen::VectorXd& a,
                                     const Eigen::VectorXd& b, const std::vector<GwStart>& starts,
                                     const GromovWassersteinOptions& options) {
  return GwSearch{c1, c2, a, b, nullptr, 1.0, starts, options}.run();
}

GwConditionalGradient gw_conditional_gradient(const Eigen::MatrixXd& c1, const Eigen::MatrixXd& c2,
                                              const Eigen::VectorXd& a, const Eigen::VectorXd& b,
                                              const Eigen::MatrixXd& start, int max_iterations) {
  check_transport(Eigen::MatrixXd::Zero(c1.rows(), c2.rows()), a, b);
  GwProblem problem;
  problem.c1 = c1;
  problem.c2 = c2;
  problem.tree1 = metric_tree(c1);
  problem.units = mass_units(a, b);
  const double total = static_cast<double>(problem.units.total);
  problem.curvature = 2.0 / total;
  std::vector<PlanCell> cells = plan_cells(start * total);
  GwDescent descent(problem);
  GwConditionalGradient result;
  result.iterations = descent.conditional_gradient(cells, max_iterations);
  result.plan.setZero(c1.rows(), c2.rows());
  for (PlanCell& cell : cells) {
    cell.mass /= total;
    result.plan(cell.row, cell.column) += cell.mass;
  }
  result.cost = problem.sparse(cells.size()) ? gw_cost(problem.c1, problem.c2, cells) : gw_cost(c1, c2, result.plan);
  return result;
}

}  // namespace anigen::eval
