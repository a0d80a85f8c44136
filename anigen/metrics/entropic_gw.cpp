#include "anigen/metrics/entropic_gw.h"

#include <algorithm>

#include "anigen/core/error.h"
#include "anigen/metrics/gw_problem.h"
#include "anigen/metrics/transport_plan.h"

namespace anigen::metrics {

namespace {

constexpr int kLookEvery = 10;

// Plain (not logarithmic) Sinkhorn, as the published solver runs it.
Eigen::MatrixXd scaled_kernel(const Eigen::MatrixXd& cost, const Eigen::VectorXd& a, const Eigen::VectorXd& b,
                              const EntropicGwOptions& options) {
  const Eigen::MatrixXd kernel = (-cost / options.epsilon).array().exp();  // K = exp(−C / ε)
  Eigen::VectorXd u = uniform_masses(static_cast<std::size_t>(a.size()));
  Eigen::VectorXd v = uniform_masses(static_cast<std::size_t>(b.size()));
  for (int i = 0; i < options.sinkhorn_iterations; ++i) {
    const Eigen::VectorXd last_u = u, last_v = v, columns = kernel.transpose() * u;
    v = b.cwiseQuotient(columns);     // v = b / Kᵀu
    u = a.cwiseQuotient(kernel * v);  // u = a / K v
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
  // Half the gradient of Σ (C1_ij − C2_kl)² T_ik T_jl (Peyré, Cuturi and Solomon 2016, proposition 1):
  // 𝓛(T) = C1² a 1ᵀ + 1 (C2² b)ᵀ − 2 C1 T C2.
  const Eigen::VectorXd first = c1.cwiseAbs2() * a, second = c2.cwiseAbs2() * b;

  EntropicGw result;
  result.plan = a * b.transpose();
  double change = 1.0;
  while (change > options.tolerance && result.iterations < options.max_iterations) {
    const Eigen::MatrixXd last = result.plan;
    Eigen::MatrixXd gradient = -4.0 * (c1 * last * c2);
    gradient.colwise() += 2.0 * first;
    gradient.rowwise() += 2.0 * second.transpose();
    if (options.solver == EntropicGwSolver::kProximalPoint) gradient.array() -= options.epsilon * last.array().log();
    result.plan = scaled_kernel(gradient, a, b, options);  // T ← Sinkhorn(2 𝓛(T), ε)
    if (result.iterations % kLookEvery == 0) change = (result.plan - last).norm();
    ++result.iterations;
  }
  const Eigen::VectorXd rows = result.plan.rowwise().sum(), columns = result.plan.colwise().sum();
  result.marginal_error = (rows - a).cwiseAbs().sum() + (columns - b).cwiseAbs().sum();
  result.cost = gw_cost(c1, c2, result.plan) * scale * scale;
  return result;
}

}  // namespace anigen::metrics
