#include "anigen/eval/transport/wasserstein.h"

#include <algorithm>
#include <cmath>

namespace anigen::eval {

Eigen::MatrixXd squared_distances(const std::vector<Eigen::Vector3d>& x, const std::vector<Eigen::Vector3d>& y) {
  Eigen::MatrixXd distances(static_cast<Eigen::Index>(x.size()), static_cast<Eigen::Index>(y.size()));
  for (std::size_t i = 0; i < x.size(); ++i) {
    for (std::size_t k = 0; k < y.size(); ++k)
      distances(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(k)) = (x[i] - y[k]).squaredNorm();
  }
  return distances;
}

JointTransport wasserstein2(const std::vector<Eigen::Vector3d>& x, const std::vector<Eigen::Vector3d>& y,
                            ExactSolver solver) {
  TransportPlan best =
      exact_transport(squared_distances(x, y), uniform_masses(x.size()), uniform_masses(y.size()), solver);
  return {std::sqrt(std::max(best.cost, 0.0)), std::move(best.plan)};
}

JointTransport wasserstein1(const std::vector<Eigen::Vector3d>& x, const std::vector<Eigen::Vector3d>& y,
                            ExactSolver solver) {
  TransportPlan best =
      exact_transport(squared_distances(x, y).cwiseSqrt(), uniform_masses(x.size()), uniform_masses(y.size()), solver);
  return {std::max(best.cost, 0.0), std::move(best.plan)};
}

SinkhornResult sinkhorn_wasserstein2(const std::vector<Eigen::Vector3d>& x, const std::vector<Eigen::Vector3d>& y,
                                     const SinkhornOptions& options) {
  return sinkhorn(squared_distances(x, y), uniform_masses(x.size()), uniform_masses(y.size()), options);
}

}  // namespace anigen::eval
