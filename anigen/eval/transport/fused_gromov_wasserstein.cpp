#include "anigen/eval/transport/fused_gromov_wasserstein.h"

#include <algorithm>
#include <cmath>

#include "anigen/core/error.h"
#include "anigen/eval/transport/exact_transport.h"
#include "anigen/eval/transport/gw_search.h"

namespace anigen::eval {

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

}  // namespace anigen::eval
