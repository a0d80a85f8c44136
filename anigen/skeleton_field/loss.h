#pragma once
#include <string>

#include "anigen/skeleton_field/field.h"

namespace anigen::skeleton_field {

// Targets of the votes of skeleton voxels for their joint and its parent (docs/reference/training.md, 3.4 and 5).

struct SkeletonLossOptions {
  FieldConfidence confidence = FieldConfidence::kExplicit;
  double alpha_conf_j = 0.1, alpha_conf_p = 0.1;  ///< of the barrier of kLearned
  double least_confidence = 0.1;                  ///< targets of the confidence are at least this
  bool crowding = true;                           ///< joints that stand close together count up to ten times
  bool squared = false;                           ///< squared distances, as the paper writes, instead of their L1 norm

  /// `"compatibility": "published"`: the defaults. `"paper"`: squared distances, confidences down to 0, no crowding.
  /// @throws InputError on another word
  static SkeletonLossOptions compatible(const std::string& compatibility);
};

/// Target of each skeleton voxel.
struct SkeletonTargets {
  torch::Tensor joints;      ///< [J, 3] fp32
  torch::Tensor joint;       ///< [M] int64, the nearest joint
  torch::Tensor parent;      ///< [M] int64, the parent of that joint; of a root: joint 0, as published
  torch::Tensor confidence;  ///< [M, 1] max(least, 1 − min(1, d₁²/(d₂² + 1e-8)))
  torch::Tensor weight;      ///< [J] clamp(max_l D_l / D_k, 1, 10), D squared distances to the nearest other joint
};
/// @param positions [M, 3] centres of the voxels @param joints [J, 3] @param parents [J] integers, -1 for a root
/// @return on the device of `positions`; no gradients @throws InputError without joints or on numbers not finite
SkeletonTargets skeleton_targets(const torch::Tensor& positions, const torch::Tensor& joints,
                                 const torch::Tensor& parents, const SkeletonLossOptions& options = {});

/// Scalars: of one asset, means over its voxels, with the loss of the confidence channel inside.
struct SkeletonLosses {
  torch::Tensor joints, parents;
};
SkeletonLosses skeleton_losses(const SkeletonField& predicted, const SkeletonTargets& targets,
                               const SkeletonLossOptions& options);

/// s of kBayesian as it is used, within ±10: e^(−s) stays a number.
torch::Tensor clamped_log_scale(const torch::Tensor& s);

}  // namespace anigen::skeleton_field
