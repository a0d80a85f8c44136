#include "anigen/metrics/gromov_wasserstein.h"

#include <algorithm>
#include <cmath>

#include "anigen/core/error.h"
#include "anigen/metrics/gw_problem.h"
#include "anigen/metrics/gw_search.h"
#include "anigen/metrics/transport_plan.h"
#include "anigen/metrics/wasserstein.h"

namespace anigen::metrics {

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

GromovWasserstein fused_gromov_wasserstein(const Eigen::MatrixXd& features, const Eigen::MatrixXd& c1,
                                           const Eigen::MatrixXd& c2, const Eigen::VectorXd& a,
                                           const Eigen::VectorXd& b, double alpha, const std::vector<GwStart>& starts,
                                           const GromovWassersteinOptions& options) {
  if (!(alpha >= 0.0 && alpha <= 1.0)) throw InputError("", "fused Gromov-Wasserstein", "alpha must lie in [0, 1]");
  if (features.rows() != c1.rows() || features.cols() != c2.rows() || !features.allFinite() ||
      (features.size() > 0 && features.minCoeff() < 0.0)) {
    throw InputError("", "fused Gromov-Wasserstein", "features must be finite, not negative, and of shape [n,m]");
  }
  // The plan that is best for the features alone is a start whatever the caller gives.
  TransportPlan matched = exact_transport(features, a, b);
  if (alpha == 0.0) {
    const double cost = std::max(matched.cost, 0.0);
    return {std::sqrt(cost), cost, std::move(matched.plan), "features", {{"features", cost}}};
  }
  std::vector<GwStart> all = {{"features", std::move(matched.plan)}};
  all.insert(all.end(), starts.begin(), starts.end());
  return GwSearch{c1, c2, a, b, &features, alpha, all, options}.run();
}

namespace {

constexpr int kLookEvery = 10;

// Plain (not logarithmic) Sinkhorn, as the published solver runs it.
Eigen::MatrixXd scaled_kernel(const Eigen::MatrixXd& cost, const Eigen::VectorXd& a, const Eigen::VectorXd& b,
                              const EntropicGwOptions& options) {
  const Eigen::MatrixXd kernel = (-cost / options.epsilon).array().exp();
  Eigen::VectorXd u = uniform_masses(static_cast<std::size_t>(a.size()));
  Eigen::VectorXd v = uniform_masses(static_cast<std::size_t>(b.size()));
  for (int i = 0; i < options.sinkhorn_iterations; ++i) {
    const Eigen::VectorXd last_u = u, last_v = v, columns = kernel.transpose() * u;
    v = b.cwiseQuotient(columns);
    u = a.cwiseQuotient(kernel * v);
    if ((columns.array() == 0.0).any() || !u.allFinite() || !v.allFinite()) {
      u = last_u;
      v = last_v;
      break;
    }
    if (i % kLookEvery == 0 && (v.cwiseProduct(kernel.transpose() * u) - b).norm() < options.sinkhorn_tolerance) break;
  }
  return u.asDiagonal() * kernel * v.asDiagonal();
}

}  // namespace

EntropicGw entropic_gromov_wasserstein(const Eigen::MatrixXd& distances1, const Eigen::MatrixXd& distances2,
                                       const Eigen::VectorXd& a, const Eigen::VectorXd& b,
                                       const EntropicGwOptions& options) {
  if (!(options.epsilon > 0.0)) throw InputError("", "entropic Gromov-Wasserstein", "epsilon must be positive");
  check_transport(Eigen::MatrixXd::Zero(distances1.rows(), distances2.rows()), a, b);
  const double largest = std::max(distances1.maxCoeff(), distances2.maxCoeff());
  const double scale = largest > 0.0 ? largest : 1.0;
  const Eigen::MatrixXd c1 = distances1 / scale, c2 = distances2 / scale;
  const Eigen::VectorXd first = c1.cwiseAbs2() * a, second = c2.cwiseAbs2() * b;

  EntropicGw result;
  result.plan = a * b.transpose();
  double change = 1.0;
  while (change > options.tolerance && result.iterations < options.max_iterations) {
    const Eigen::MatrixXd last = result.plan;
    Eigen::MatrixXd gradient = -4.0 * (c1 * last * c2);
    gradient.colwise() += 2.0 * first;
    gradient.rowwise() += 2.0 * second.transpose();
    if (options.solver == EntropicGwSolver::kProximalPoint) {
      gradient.array() -= options.epsilon * last.array().log();
    }
    result.plan = scaled_kernel(gradient, a, b, options);
    if (result.iterations % kLookEvery == 0) change = (result.plan - last).norm();
    ++result.iterations;
  }
  const Eigen::VectorXd rows = result.plan.rowwise().sum(), columns = result.plan.colwise().sum();
  result.marginal_error = (rows - a).cwiseAbs().sum() + (columns - b).cwiseAbs().sum();
  result.cost = gw_cost(c1, c2, result.plan) * scale * scale;
  return result;
}

}  // namespace anigen::metrics
