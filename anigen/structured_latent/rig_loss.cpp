#include "anigen/structured_latent/rig_loss.h"

#include <algorithm>
#include <cstddef>

#include "anigen/core/error.h"

namespace anigen::structured_latent {

namespace {

using torch::Tensor;

void add_skin_terms(const RigPrediction& predicted, const RigTruth& truth,
                    const skeleton_field::SkeletonTargets& voxels, const RigLossOptions& options, RigLosses& sums) {
  if (predicted.variance.defined()) sums.skin_var = sums.skin_var + predicted.variance;
  const skin_field::SkinTargets targets =
      skin_field::skin_targets(truth.mix, truth.skin, truth.vertex_features, truth.joints, predicted.joints);
  if (predicted.skin.defined())
    sums.skin_kl = sums.skin_kl + skin_field::skin_weight_kl(predicted.skin, targets.weights);
  if (targets.features.defined())
    sums.skin_feats_l2_vert = sums.skin_feats_l2_vert + (predicted.vertex_features - targets.features).square().mean();
  if (!truth.joint_features.defined()) return;
  const Tensor confidence = options.true_feature_confidence ? voxels.confidence : predicted.field.conf_skin;
  sums.skin_feats_l2_joints =
      sums.skin_feats_l2_joints +
      skin_field::joint_feature_loss(predicted.field.skin_features, truth.joint_features, voxels, confidence);
}

}  // namespace

// λ_J L_J + λ_P L_P + λ_var L_var + λ_kl KL(W ‖ Ŵ) + λ_V ‖f_V − f̂_V‖² + λ_W ‖W^j − Ŵ^j‖²
Tensor RigLosses::total(const RigLossOptions& options) const {
  return options.lambda_joints * joints + options.lambda_parents * parents + options.lambda_skin_var * skin_var +
         options.lambda_skin_kl * skin_kl + options.lambda_skin_feats_l2 * skin_feats_l2_vert +
         options.lambda_skin_feats_l2_skl * skin_feats_l2_joints;
}

RigLosses rig_losses(const std::vector<RigPrediction>& predictions, const std::vector<RigTruth>& truths,
                     const RigLossOptions& options) {
  if (predictions.empty() || predictions.size() != truths.size())
    throw InputError("", "", "a loss needs predictions, and one truth for each");
  const Tensor zero = torch::zeros({}, predictions.front().field.joints.options());
  RigLosses sums{zero, zero, zero, zero, zero, zero};
  std::size_t meshes = 0;
  for (std::size_t i = 0; i < predictions.size(); ++i) {
    const RigPrediction& predicted = predictions[i];
    const RigTruth& truth = truths[i];
    const skeleton_field::SkeletonTargets voxels =
        skeleton_field::skeleton_targets(predicted.field.positions, truth.joints, truth.parents, options.skeleton);
    const skeleton_field::SkeletonLosses votes =
        skeleton_field::skeleton_losses(predicted.field, voxels, options.skeleton);
    sums.joints = sums.joints + votes.joints;
    sums.parents = sums.parents + votes.parents;
    if (!predicted.mesh) continue;
    ++meshes;
    if (!truth.is_bad_skin) add_skin_terms(predicted, truth, voxels, options, sums);
  }
  const auto assets = static_cast<double>(predictions.size());
  const auto counted = static_cast<double>(std::max<std::size_t>(1, meshes));
  return {sums.joints / assets,
          sums.parents / assets,
          sums.skin_var / counted,
          sums.skin_kl / counted,
          sums.skin_feats_l2_vert / counted,
          sums.skin_feats_l2_joints / counted};
}

}  // namespace anigen::structured_latent
