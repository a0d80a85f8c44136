#pragma once
#include <Eigen/Core>
#include <vector>

#include "anigen/eval/align/similarity.h"

namespace anigen::eval {

/// How a transform between paired points is scaled.
enum class PairScale {
  kFixed,         ///< 1: rigid
  kLeastSquares,  ///< what minimises the squared distances together with the rotation (Umeyama 1991); ICP's
  kSizeRatio      ///< the ratio of the point sets' RMS radii, the same seen from either side (trimesh's)
};

/// Weighted pairs from → to, reduced to sums as they arrive, so that ICP need not store them. Sums are taken relative
/// to the first pair: far-away coordinates do not cancel.
class ProcrustesSums {
 public:
  void add(const Eigen::Vector3d& from, const Eigen::Vector3d& to, double weight = 1.0);

  /// The transform T that minimises Σ w |T(from) − to|² (Kabsch 1976), never a reflection; with kSizeRatio that among
  /// transforms of this scale. Where several are optimal — coincident or collinear pairs — one of them, always the same
  /// for the same pairs; coincident ones give no rotation. A scale that the pairs do not define (no extent on either
  /// side) is 1. @throws InputError when the weights sum to nothing
  Similarity solve(PairScale scale) const;

 private:
  double weight_ = 0.0, from_squared_ = 0.0, to_squared_ = 0.0;
  Eigen::Vector3d from_origin_ = Eigen::Vector3d::Zero(), to_origin_ = Eigen::Vector3d::Zero();
  Eigen::Vector3d from_ = Eigen::Vector3d::Zero(), to_ = Eigen::Vector3d::Zero();
  Eigen::Matrix3d cross_ = Eigen::Matrix3d::Zero();  ///< Σ w from toᵀ
  bool empty_ = true;
};

/// ProcrustesSums over paired rows. @param weights one per pair, ≥ 0; empty: all 1
/// @throws InputError when lengths differ, there is no pair, a number is not finite or a weight is negative
Similarity procrustes(const std::vector<Eigen::Vector3d>& from, const std::vector<Eigen::Vector3d>& to, PairScale scale,
                      const std::vector<double>& weights = {});

}  // namespace anigen::eval
