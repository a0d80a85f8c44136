#pragma once
#include "anigen/models/structured_latent_skeleton_loss.h"
#include "anigen/models/vertex_mix.h"

namespace anigen::models {

// What the dual skin field is compared with (reference training-and-data.md, 3.3, skin terms). Of one asset.

/// What vertices of a predicted mesh ought to have, read off the true mesh; no gradients.
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
                                 const SkeletonTargets& targets, const torch::Tensor& confidence);

}  // namespace anigen::models
