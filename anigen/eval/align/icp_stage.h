#pragma once
#include <Eigen/Core>
#include <cstddef>
#include <vector>

#include "anigen/eval/align/alignment_shape.h"
#include "anigen/eval/align/similarity.h"

namespace anigen::eval {

/// What an ICP update minimises, given the current nearest points.
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

}  // namespace anigen::eval
