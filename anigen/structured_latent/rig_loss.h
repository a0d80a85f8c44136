#pragma once
#include <vector>

#include "anigen/skin_field/loss.h"

namespace anigen::structured_latent {

/// Weights of the terms; names and defaults of the published trainer's arguments.
struct RigLossOptions {
  skeleton_field::SkeletonLossOptions skeleton;
  double lambda_joints = 1.0, lambda_parents = 1.0;
  double lambda_skin_kl = 0.5, lambda_skin_var = 1.0;
  double lambda_skin_feats_l2 = 1.0, lambda_skin_feats_l2_skl = 1.0;
  /// The paper weights the features of joints with the true confidence, the published code with the predicted one.
  bool true_feature_confidence = false;
};

/// Decoded fields of one asset.
struct RigPrediction {
  skeleton_field::SkeletonField field;
  torch::Tensor joints;           ///< [J', 3] that the weights are over: given or grouped
  torch::Tensor variance;         ///< scalar, of skeleton_field::joint_skin_features
  bool mesh = false;              ///< whether there is a surface; without, the following are undefined
  torch::Tensor vertex_features;  ///< [V, F] skin features of (some of) its vertices
  torch::Tensor skin;             ///< [V, J'] their decoded weights; undefined: no divergence
};

/// Targets of one asset.
struct RigTruth {
  torch::Tensor joints, parents;  ///< [J, 3], [J]
  torch::Tensor joint_features;   ///< [J, F] of the SkinAE; undefined: no loss on features of joints
  torch::Tensor skin;             ///< [Vgt, J]
  torch::Tensor vertex_features;  ///< [Vgt, F] of the SkinAE; undefined: no loss on features of vertices
  skin_field::VertexMix mix;      ///< of the predicted vertices over the true ones
  bool is_bad_skin = false;       ///< then only the skeleton counts
};

/// Scalars: joints and parents are means over assets, the skin terms sums over assets with a mesh and good skin divided
/// by the number of assets with a mesh, at least 1, as published. 0 where there was nothing to compare.
struct RigLosses {
  torch::Tensor joints, parents;
  torch::Tensor skin_var, skin_kl, skin_feats_l2_vert, skin_feats_l2_joints;
  torch::Tensor total(const RigLossOptions& options) const;
};
/// @throws InputError when there is not one truth per prediction, or none
RigLosses rig_losses(const std::vector<RigPrediction>& predictions, const std::vector<RigTruth>& truths,
                     const RigLossOptions& options);

}  // namespace anigen::structured_latent
