#pragma once
#include <Eigen/Core>
#include <limits>
#include <string>

#include "anigen/metrics/entropic_gw.h"
#include "anigen/metrics/gromov_wasserstein.h"
#include "anigen/metrics/gw_bound.h"
#include "anigen/metrics/metric_skeleton.h"
#include "anigen/metrics/sinkhorn.h"

namespace anigen::metrics {

struct TransportOptions {
  double alpha = 0.5;  ///< of the fused distance: (1 - alpha) squared Euclidean + alpha geodesic
  bool sinkhorn =
      false;  ///< also report the entropic approximations of the Wasserstein and Gromov–Wasserstein distances
  SinkhornOptions sinkhorn_options;
  EntropicGwOptions entropic_options;
  GromovWassersteinOptions gromov_wasserstein_options;
};

/// Every transport distance of one pair of skeletons, all in the unit of the positions.
struct SkeletonTransport {
  double wasserstein = 0.0;               ///< W2 of the joint sets, exact
  double gromov_wasserstein = 0.0;        ///< of the geodesic distances; best coupling found
  double fused_gromov_wasserstein = 0.0;  ///< with alpha of the options; best coupling found
  double gw_lower_bound = 0.0;            ///< certified: the true Gromov–Wasserstein distance is not below
  double sinkhorn_wasserstein = std::numeric_limits<double>::quiet_NaN();  ///< only when asked for
  double sinkhorn_gap = std::numeric_limits<double>::quiet_NaN();          ///< certified, of squared distances
  bool sinkhorn_converged = false;                                         ///< its marginals reached the tolerance
  /// Root of the Gromov–Wasserstein cost of the entropic plan, whose marginals are repaired (round_to_coupling), so an
  /// upper bound of the minimum; only when asked for.
  double entropic_gromov_wasserstein = std::numeric_limits<double>::quiet_NaN();
  double entropic_marginal_error = std::numeric_limits<double>::quiet_NaN();  ///< L1, before the repair
  Eigen::MatrixXd plan;   ///< [n,m] of the Wasserstein distance: rows sum to 1/n, columns to 1/m
  std::string gw_start;   ///< where the best Gromov–Wasserstein coupling came from
  std::string fgw_start;  ///< and the fused one
};

/// Joints with equal masses 1/n and 1/m; forests are joined by connected() for the geodesics. Both skeletons are first
/// numbered canonically, so the result does not depend on the order of joints. Thread-safe, one thread.
/// @param predicted n joints, @param truth m joints
SkeletonTransport skeleton_transport(const MetricSkeleton& predicted, const MetricSkeleton& truth,
                                     const TransportOptions& options = {});

}  // namespace anigen::metrics
