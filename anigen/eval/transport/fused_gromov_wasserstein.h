#pragma once
#include <Eigen/Core>
#include <vector>

#include "anigen/eval/transport/gromov_wasserstein.h"

namespace anigen::eval {

/// Fused Gromov–Wasserstein (Vayer et al. 2019, q = 2): the least over couplings of
///   (1 - alpha) * <M, plan> + alpha * sum (d1 - d2)^2 plan plan,
/// with M squared Euclidean distances of matched joints. It sees both where joints are and how they are connected; the
/// value is the root, in the unit of the positions. Same search as gromov_wasserstein.
/// @param features M [n,m]  nonnegative, in squared units of the distances
/// @param alpha in [0, 1]: 0 is Wasserstein (then exact), 1 is Gromov–Wasserstein
GromovWasserstein fused_gromov_wasserstein(const Eigen::MatrixXd& features, const Eigen::MatrixXd& c1,
                                           const Eigen::MatrixXd& c2, const Eigen::VectorXd& a,
                                           const Eigen::VectorXd& b, double alpha = 0.5,
                                           const std::vector<GwStart>& starts = {},
                                           const GromovWassersteinOptions& options = {});

}  // namespace anigen::eval
