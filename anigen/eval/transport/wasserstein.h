#pragma once
#include <Eigen/Core>
#include <vector>

#include "anigen/eval/transport/exact_transport.h"
#include "anigen/eval/transport/sinkhorn.h"
#include "anigen/eval/transport/transport_plan.h"

namespace anigen::eval {

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

}  // namespace anigen::eval
