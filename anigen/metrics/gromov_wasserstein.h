#pragma once
#include <Eigen/Core>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "anigen/metrics/gw_starts.h"

namespace anigen::metrics {

/// Pairs of joints up to which the iterated search runs all its rounds; about 90 joints a side.
inline constexpr int kFullSearchCells = 8000;

struct GromovWassersteinOptions {
  int descents = 4;  ///< starts that go on to a local minimum: those of least cost
  /// Rounds of iterated local search after the starts, at least: a few random exchanges of the best coupling or, with
  /// equal masses, of the partners of two neighbourhoods or two branches, then descent. Up to twelve times as many
  /// while they improve. Drawn from a stream of this seed in the canonical numbering, so equal input gives equal
  /// output. One takes time in proportion to n·m: beyond kFullSearchCells of them there are fewer, so that all take as
  /// long.
  int perturbations = 130;
  std::uint64_t seed = 0;
  bool entropic = false;  ///< also start from an entropic (proximal) plan; slower, seldom better
};

/// The best coupling found and where it came from. The problem is a nonconvex quadratic program, so `cost` is an upper
/// bound of the minimum; gw_lower_bound bounds it from the other side.
struct GromovWasserstein {
  double value = 0.0;    ///< root of the cost, in the unit of the distances
  double cost = 0.0;     ///< sum (d1 - d2)^2 plan plan, no factor 1/2; never negative
  Eigen::MatrixXd plan;  ///< [n,m] a vertex (sparse), rows sum to a, columns to b
  std::string start;     ///< name of the start that won; "+ exchanges" when the iterated search improved on it
  std::vector<std::pair<std::string, double>> costs;  ///< of every start, where it stopped
};

/// Gromov–Wasserstein distance with square loss (equation 8 of the paper; Mémoli's definition has a factor 1/2 more).
/// Conditional gradient and exchanges from the cheapest few of several deterministic starts, the best kept: an
/// isomorphism when the two trees have one (then the minimum is 0 and nothing else is tried), joints sorted by mean
/// distance, eccentricity and position along the longest path, the coupling of the third lower bound, turns of either
/// side for metrics that are no tree's, and `starts`.
/// Tree geodesics are recognised by themselves and numbered canonically first, so labels do not matter; other metrics
/// are solved as they come.
/// @param c1 [n,n], @param c2 [m,m]  symmetric, zero diagonal, nonnegative
/// @param a [n], @param b [m]  masses that sum to 1
/// @param starts more couplings to start from, for example the Wasserstein plan of the joints
/// @throws InputError for anything else, naming what is wrong
GromovWasserstein gromov_wasserstein(const Eigen::MatrixXd& c1, const Eigen::MatrixXd& c2, const Eigen::VectorXd& a,
                                     const Eigen::VectorXd& b, const std::vector<GwStart>& starts = {},
                                     const GromovWassersteinOptions& options = {});

/// Conditional gradient from one coupling and nothing else: what the published solvers do.
struct GwConditionalGradient {
  double cost = 0.0;
  int iterations = 0;
  Eigen::MatrixXd plan;
};
GwConditionalGradient gw_conditional_gradient(const Eigen::MatrixXd& c1, const Eigen::MatrixXd& c2,
                                              const Eigen::VectorXd& a, const Eigen::VectorXd& b,
                                              const Eigen::MatrixXd& start, int max_iterations = 1000);

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

}  // namespace anigen::metrics
