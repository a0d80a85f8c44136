#include "anigen/metrics/skeleton_transport.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "anigen/core/numeric.h"
#include "anigen/metrics/gw_problem.h"
#include "anigen/metrics/wasserstein.h"

namespace anigen::metrics {

namespace {

using Points = std::vector<Eigen::Vector3d>;

Points picked(const Points& points, const std::vector<int>& order) {
  Points result;
  for (const int joint : order) result.push_back(points[at(joint)]);
  return result;
}

}  // namespace

SkeletonTransport skeleton_transport(const MetricSkeleton& predicted, const MetricSkeleton& truth,
                                     const TransportOptions& options) {
  const Eigen::VectorXd a = uniform_masses(predicted.size()), b = uniform_masses(truth.size());
  const CanonicalOrder order =
      canonical_order({bone_tree(predicted), a, predicted.positions}, {bone_tree(truth), b, truth.positions});
  const Points x = picked(predicted.positions, order.first), y = picked(truth.positions, order.second);
  const Eigen::MatrixXd c1 = path_lengths(order.first_tree), c2 = path_lengths(order.second_tree);

  SkeletonTransport result;
  const JointTransport matched = wasserstein2(x, y);
  result.wasserstein = matched.distance;
  result.plan.setZero(static_cast<Eigen::Index>(x.size()), static_cast<Eigen::Index>(y.size()));
  for (const PlanCell& cell : plan_cells(matched.plan))
    result.plan(order.first[at(cell.row)], order.second[at(cell.column)]) = cell.mass;

  const GromovWassersteinOptions& search = options.gromov_wasserstein_options;
  const GromovWasserstein gw = gromov_wasserstein(c1, c2, a, b, {{"wasserstein", matched.plan}}, search);
  result.gromov_wasserstein = gw.value;
  result.gw_start = gw.start;
  result.gw_lower_bound = gw_lower_bound(c1, c2, a, b).best;

  // The positions of joints leave it fewer local minima.
  GromovWassersteinOptions shorter = search;
  shorter.perturbations /= 3;
  const GromovWasserstein fused = fused_gromov_wasserstein(squared_distances(x, y), c1, c2, a, b, options.alpha,
                                                           {{"gromov-wasserstein", gw.plan}}, shorter);
  result.fused_gromov_wasserstein = fused.value;
  result.fgw_start = fused.start;

  if (options.sinkhorn) {
    const SinkhornResult entropic = sinkhorn_wasserstein2(x, y, options.sinkhorn_options);
    result.sinkhorn_wasserstein = std::sqrt(std::max(entropic.cost, 0.0));
    result.sinkhorn_gap = entropic.gap();
    result.sinkhorn_converged = entropic.converged;
    const EntropicGw found = entropic_gromov_wasserstein(c1, c2, a, b, options.entropic_options);
    result.entropic_marginal_error = found.marginal_error;
    result.entropic_gromov_wasserstein = std::sqrt(std::max(gw_cost(c1, c2, round_to_coupling(found.plan, a, b)), 0.0));
  }
  return result;
}

}  // namespace anigen::metrics
