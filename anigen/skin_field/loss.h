#pragma once
#include <string>
#include <vector>

#include "anigen/nn/torch.h"
#include "anigen/skeleton_field/loss.h"
#include "anigen/skin_field/sampling.h"

namespace anigen::skin_field {

/// Divisor of the sum of gt (log gt − log pred) over all points and joints of an asset.
enum class SkinKlMean {
  kElements,  ///< V·J, as the published code does by a slip of an argument (docs/reference/training.md, 3.1)
  kRows       ///< V, the mean divergence of a point, as the paper says
};

/// Weights of the terms; names and defaults are the published trainer arguments.
struct SkinLossOptions {
  double lambda_kl_skin = 1.0;
  double lambda_l1_skin = 0.0;
  double lambda_l2_skin = 0.0;
  SkinKlMean kl_mean = SkinKlMean::kElements;
  double epsilon = 1e-10;  ///< added to the prediction inside the logarithm; 0: none

  /// `"compatibility": "published"`: the defaults. `"paper"`: mean over points, exact logarithm.
  /// @throws InputError on another word
  static SkinLossOptions compatible(const std::string& compatibility);
};

/// Scalars; each the mean over the assets. A term whose weight is 0 is undefined and costs nothing.
struct SkinLosses {
  torch::Tensor total;
  torch::Tensor kl;  ///< KL(gt ‖ pred), 0 log 0 = 0
  torch::Tensor l1;  ///< mean |pred − gt| over all entries
  torch::Tensor l2;  ///< mean (pred − gt)²
};

/// From logarithms of the weights, as SkinDecoder::decode_log gives them: no logarithm of an underflowed weight.
/// @param log_predicted, target per asset [V, J]; target rows sum to 1
/// @throws InputError naming the asset when shapes differ or there is none
SkinLosses skin_losses_from_log(const std::vector<torch::Tensor>& log_predicted,
                                const std::vector<torch::Tensor>& target, const SkinLossOptions& options);

/// As above, from the weights themselves.
SkinLosses skin_losses(const std::vector<torch::Tensor>& predicted, const std::vector<torch::Tensor>& target,
                       const SkinLossOptions& options);

// Targets of the dual skin field (docs/reference/training.md, 3.5). Of one asset.

/// Targets at the vertices of a predicted mesh, read off the true mesh; no gradients.
struct SkinTargets {
  torch::Tensor weights;   ///< [V, J'] rows sum to 1: true weights, columns of the joints that were predicted
  torch::Tensor features;  ///< [V, F]; undefined: there are none
};
/// @param mix of the predicted vertices over the true ones @param skin [Vgt, J] @param features [Vgt, F] or undefined
/// @param joints [J, 3] true @param predicted_joints [J', 3], each of which takes the column of the nearest true joint
SkinTargets skin_targets(const VertexMix& mix, const torch::Tensor& skin, const torch::Tensor& features,
                         const torch::Tensor& joints, const torch::Tensor& predicted_joints);

/// Mean over vertices of KL(truth ‖ predicted); predicted weights count as at least 1e-8. @param predicted [V, J]
/// @return scalar
torch::Tensor skin_weight_kl(const torch::Tensor& predicted, const torch::Tensor& truth);

/// Mean of c (ê − E_j)² over the skeleton voxels and channels, E_j the feature of the voxel's nearest joint.
/// @param features [M, F] @param joint_features [J, F] @param confidence [M, 1], with its gradient; undefined: 1
torch::Tensor joint_feature_loss(const torch::Tensor& features, const torch::Tensor& joint_features,
                                 const skeleton_field::SkeletonTargets& targets, const torch::Tensor& confidence);

}  // namespace anigen::skin_field
