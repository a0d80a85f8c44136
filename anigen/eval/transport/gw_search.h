#pragma once
#include <Eigen/Core>
#include <vector>

#include "anigen/eval/transport/gromov_wasserstein.h"

namespace anigen::eval {

/// The search that gromov_wasserstein and fused_gromov_wasserstein share: minimises
///   (1 - alpha) <features, plan> + alpha sum (d1 - d2)^2 plan plan.
struct GwSearch {
  const Eigen::MatrixXd &c1, &c2;
  const Eigen::VectorXd &a, &b;
  const Eigen::MatrixXd* features = nullptr;  ///< [n,m], or null for none
  double alpha = 1.0;
  const std::vector<GwStart>& starts;
  const GromovWassersteinOptions& options;

  /// @throws InputError for matrices that are not distances, masses that do not sum to 1, starts of the wrong shape
  GromovWasserstein run() const;
};

}  // namespace anigen::eval
