#pragma once
#include <Eigen/Core>

namespace anigen::metrics {

enum class EntropicGwSolver {
  kProjectedGradient,  ///< PGD: mirror descent on cost + epsilon * negative entropy (Peyré, Cuturi and Solomon 2016)
  kProximalPoint,      ///< PPA: the entropy is taken relative to the last plan, so it vanishes at the limit (Xu et al.
                       ///< 2019)
};

struct EntropicGwOptions {
  EntropicGwSolver solver = EntropicGwSolver::kProjectedGradient;
  double epsilon = 5e-3;  ///< in the unit of squared distances after division by the largest distance of both spaces
  int max_iterations = 200;
  double tolerance = 1e-9;  ///< on the Frobenius norm of a plan's change, looked at every 10th iteration
  int sinkhorn_iterations = 1000;
  double sinkhorn_tolerance = 1e-9;  ///< on the Euclidean norm of the column masses' error, looked at every 10th
};

struct EntropicGw {
  Eigen::MatrixXd plan;  ///< [n,m]; columns may miss their masses by marginal_error
  double cost = 0.0;     ///< Gromov–Wasserstein cost of the plan without entropy, in squared units of the input
  double marginal_error = 0.0;  ///< L1 over rows and columns
  int iterations = 0;
};

/// Entropic Gromov–Wasserstein with square loss from the product plan, both matrices divided by the largest distance:
/// plan <- Sinkhorn(2 (const - 2 C1 plan C2), epsilon), with epsilon log(plan) subtracted for the proximal variant.
/// Iterates in the order of the published solver (POT), so that plans agree with it. Should a scaling leave the range
/// of double precision, the last good one counts.
/// @param c1 [n,n], @param c2 [m,m]  symmetric, @param a [n], @param b [m]
EntropicGw entropic_gromov_wasserstein(const Eigen::MatrixXd& c1, const Eigen::MatrixXd& c2, const Eigen::VectorXd& a,
                                       const Eigen::VectorXd& b, const EntropicGwOptions& options = {});

}  // namespace anigen::metrics
