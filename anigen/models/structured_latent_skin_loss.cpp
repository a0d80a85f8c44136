#include "anigen/models/structured_latent_skin_loss.h"

#include <vector>

#include "anigen/core/error.h"
#include "anigen/fields/tensor_points.h"
#include "anigen/geometry/joint_field.h"

namespace anigen::models {
namespace {

using torch::Tensor;

constexpr double kLeastPredictedWeight = 1e-8;
constexpr double kLeastRowSum = 1e-8;

// Column of the true weights for each predicted joint.
Tensor matching_columns(const Tensor& joints, const Tensor& predicted_joints) {
  const std::vector<geometry::NearestJoints> nearest = geometry::nearest_joints(
      fields::points_of<double>(predicted_joints, "predicted joints"), fields::points_of<double>(joints, "joints"));
  std::vector<std::int64_t> columns;
  for (const geometry::NearestJoints& one : nearest) columns.push_back(one.joint);
  return torch::tensor(columns, torch::kInt64).to(joints.device());
}

}  // namespace

SkinTargets skin_targets(const VertexMix& mix, const Tensor& skin, const Tensor& features, const Tensor& joints,
                         const Tensor& predicted_joints) {
  const torch::NoGradGuard no_grad;
  SkinTargets targets;
  const Tensor gathered = skin.index_select(1, matching_columns(joints, predicted_joints).to(skin.device()));
  const Tensor rows = mixed(gathered, mix);
  targets.weights = rows / rows.sum(1, /*keepdim=*/true).clamp_min(kLeastRowSum);
  if (features.defined()) targets.features = mixed(features.detach(), mix);
  return targets;
}

Tensor skin_weight_kl(const Tensor& predicted, const Tensor& truth) {
  if (predicted.dim() != 2 || predicted.sizes() != truth.sizes() || predicted.numel() == 0) {
    throw InputError("", "",
                     "predicted and true skin weights must be [V, J] and alike, found " + nn::shape_text(predicted) +
                         " and " + nn::shape_text(truth));
  }
  const Tensor logarithm = torch::log(predicted.clamp_min(kLeastPredictedWeight));
  return (torch::xlogy(truth, truth) - truth * logarithm).sum() / static_cast<double>(truth.size(0));
}

Tensor joint_feature_loss(const Tensor& features, const Tensor& joint_features, const SkeletonTargets& targets,
                          const Tensor& confidence) {
  const Tensor wanted = joint_features.detach().index_select(0, targets.joint);
  const Tensor error = (features - wanted).square();
  return confidence.defined() ? (confidence * error).mean() : error.mean();
}

}  // namespace anigen::models
