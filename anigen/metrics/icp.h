#pragma once
#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <vector>

#include "anigen/core/random.h"
#include "anigen/metrics/similarity.h"

namespace anigen::metrics {

/// A rotation uniform over SO(3), from three draws (Shoemake, Uniform random rotations, Graphics Gems III, 1992).
Eigen::Matrix3d random_rotation(Rng& rng);

/// `count` of them; rotation i comes from the stream (seed, "alignment rotation", i), so a longer list starts with a
/// shorter one.
std::vector<Eigen::Matrix3d> random_rotations(int count, std::uint64_t seed);

/// Rotations that lay the principal axes of one point set onto those of another: the four choices of signs without a
/// reflection; where two variances are within 10 % of each other their axes say little, and all 24 assignments of
/// axes are tried. None when either set has no extent.
std::vector<Eigen::Matrix3d> principal_axis_rotations(const Eigen::Matrix3d& from_covariance,
                                                      const Eigen::Matrix3d& to_covariance);

/// Objective of an ICP update, given the current nearest points.
enum class IcpVariant {
  kPointToPoint,  ///< Σ |T(p) − q|², closed form (Besl and McKay 1992)
  kPointToPlane  ///< Σ (n · (T(p) − q))², one Gauss–Newton step (Chen and Medioni 1992); where that step makes the
                 ///< distances larger, the closed form takes its place
};

/// One level of detail of ICP. Nearest points are looked up in both directions, so that every part of either shape
/// pulls: a small part of one cannot hide inside the other, and an estimated scale cannot collapse.
struct IcpStage {
  enum class Target {
    kCoarseSamples,  ///< the shapes' coarse samples
    kSamples,        ///< all samples
    kSurface         ///< the surfaces themselves, or all samples where a shape has none
  };
  Target target = Target::kSamples;
  std::size_t samples = 1000;  ///< of each shape, looked up in the other
  int max_iterations = 50;
  double tolerance = 1e-6;  ///< stop when an iteration lowers the residual by less than this share of it
  IcpVariant variant = IcpVariant::kPointToPoint;
  bool both_directions = true;
  bool similarity = false;  ///< re-estimate the scale, too
  double trim = 1.0;  ///< share of each direction's pairs that is kept, the nearest ones (Chetverikov et al. 2002)
};

struct IcpState {
  Similarity transform;   ///< source → target
  double residual = 0.0;  ///< root mean square distance of the kept pairs, both directions counting equally
  int iterations = 0;
};

/// Iterates from a start until the residual stops falling; it never rises.
IcpState run_stage(const AlignmentShape& source, const AlignmentShape& target, const Similarity& start,
                   const IcpStage& stage);

/// The residual alone.
double stage_residual(const AlignmentShape& source, const AlignmentShape& target, const Similarity& transform,
                      const IcpStage& stage);

/// Registration from many starting rotations, the best kept. The paper states 100 random rotations and nothing else
/// (docs/reference/training.md, 7.1); everything that it leaves open is an option here.
///
/// Rule of pruning, unless `exhaustive`: every start is iterated at low detail (100 samples against 1,000, one
/// direction, at most 15 iterations, point to point); the 16 with the lowest residual of 200 samples a side go on with
/// 250 samples in both directions; of those, without repetitions of one another, the at most 8 within 30 % of the best
/// with half of `samples` a side and the chosen variant; of those, again without repetitions, the at most 4 within 10 %
/// of the best to the surfaces themselves. A residual below 5 % of the shape's RMS radius, which sampling alone can
/// cause, counts as within; what the identity start leads to is never dropped. `exhaustive` takes every start through
/// all of this. It is a rule, not a proof: a start can be dropped that would have won.
///
/// Final residuals that do not differ by more than 0.1 % or by the rounding of single precision are equal, as those of
/// a shape with a rotational symmetry. Of equal ones what the identity start led to wins if it turned by less than 0.2
/// radians: a prediction that lies right stays; else the one whose samples lie closest, which finds back the triangles
/// of the same mesh.
struct IcpOptions {
  int rotations = 100;               ///< random starts beside the identity, 0 … 100,000
  bool principal_axes = true;        ///< also try the rotations that lay principal axes onto one another
  std::size_t samples = 2000;        ///< per shape in the finest stage on samples
  std::size_t score_samples = 5000;  ///< per shape for the final residual, which decides between the last candidates
  int max_iterations = 50;           ///< of each of the finer stages
  IcpVariant variant = IcpVariant::kPointToPoint;
  bool similarity = false;  ///< re-estimate the scale, too
  double trim = 1.0;        ///< share of pairs kept, in (0, 1]
  bool to_surface = true;   ///< finish on the surfaces themselves, which takes out the noise of sampling; the steps
                            ///< are point-to-plane ones, the residual is that of point to point
  bool exhaustive = false;  ///< no pruning
  bool parallel = false;    ///< spread the starts over all threads; the result is the same
  std::uint64_t seed = 0;
};

/// @throws InputError naming the option that is out of range
void check(const IcpOptions& options);

struct IcpResult {
  Similarity transform;  ///< source → target
  double rmse = 0.0;  ///< √(½ (mean d(source sample, target)² + mean d(target sample, source)²)) over the kept pairs,
                      ///< in the target's unit; d is the distance to the surface where there is one
  double runner_up = 0.0;  ///< rmse of the best candidate that came to lie elsewhere; as low as rmse: the shape has a
                           ///< rotational symmetry, or nearly; infinite when there was none
  int start = 0;       ///< which start won: 0 the identity, 1 … rotations a random one, beyond that principal axes
  int iterations = 0;  ///< that it took, over all stages
  int starts = 0;      ///< how many there were
  int refined = 0;     ///< how many reached the last stage
};

/// Shapes prepared with at least max(samples, score_samples) samples. The identity start is the identity; every other
/// start turns the source about its centroid and lays that onto the target's.
IcpResult register_shapes(const AlignmentShape& source, const AlignmentShape& target, const IcpOptions& options = {});

/// Nearest point of the target, in the target's frame.
using NearestPointFunction = std::function<Eigen::Vector3d(const Eigen::Vector3d&)>;

/// Plain ICP from one start, in one direction: nearest points, Procrustes on the pairs, until an iteration lowers the
/// mean squared distance by less than `threshold` or max_iterations were made (Besl and McKay 1992).
/// @throws InputError without points, or on one that is not finite
IcpState plain_icp(const std::vector<Eigen::Vector3d>& source, const NearestPointFunction& nearest,
                   const Similarity& start, int max_iterations, double threshold, bool similarity = false);

}  // namespace anigen::metrics
