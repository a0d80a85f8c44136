#include "anigen/skin_field/loss.h"

#include <cmath>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/nn/init.h"
#include "anigen/skeleton_field/field.h"

namespace anigen::skin_field {

namespace {

using torch::Tensor;

void check_shapes(const std::vector<Tensor>& predicted, const std::vector<Tensor>& target) {
  if (predicted.empty() || predicted.size() != target.size()) {
    throw InputError("", "",
                     "a skin loss needs one target per prediction: " + std::to_string(predicted.size()) +
                         " predictions, " + std::to_string(target.size()) + " targets");
  }
  for (std::size_t i = 0; i < predicted.size(); ++i) {
    if (predicted[i].dim() == 2 && predicted[i].numel() > 0 && predicted[i].sizes() == target[i].sizes()) continue;
    throw InputError("", "asset " + std::to_string(i),
                     "predicted and target skin weights differ in shape or are empty");
  }
}

// Σ gt (log gt − log pred), divided as the options say.
Tensor kl_divergence(const Tensor& log_predicted, const Tensor& target, SkinKlMean mean) {
  const Tensor pointwise = torch::xlogy(target, target) - target * log_predicted;
  return mean == SkinKlMean::kElements ? pointwise.mean() : pointwise.sum() / static_cast<double>(target.size(0));
}

// @param logarithm, weights of a prediction, in whatever form it comes
template <typename Logarithm, typename Weights>
SkinLosses losses_of(const std::vector<Tensor>& predicted, const std::vector<Tensor>& target,
                     const SkinLossOptions& options, const Logarithm& logarithm, const Weights& weights) {
  check_shapes(predicted, target);
  SkinLosses losses;  // sums over the assets of the terms that count, then means
  const auto accumulate = [](Tensor& sum, const Tensor& term) { sum = sum.defined() ? sum + term : term; };
  for (std::size_t i = 0; i < target.size(); ++i) {
    if (options.lambda_kl_skin != 0.0)
      accumulate(losses.kl, kl_divergence(logarithm(predicted[i]), target[i], options.kl_mean));
    if (options.lambda_l1_skin == 0.0 && options.lambda_l2_skin == 0.0) continue;
    const Tensor difference = weights(predicted[i]) - target[i];
    if (options.lambda_l1_skin != 0.0) accumulate(losses.l1, difference.abs().mean());
    if (options.lambda_l2_skin != 0.0) accumulate(losses.l2, difference.square().mean());
  }
  const std::pair<double, Tensor*> terms[] = {
      {options.lambda_kl_skin, &losses.kl}, {options.lambda_l1_skin, &losses.l1}, {options.lambda_l2_skin, &losses.l2}};
  for (const auto& [weight, mean] : terms) {
    if (!mean->defined()) continue;
    *mean = *mean / static_cast<double>(target.size());
    accumulate(losses.total, weight * *mean);
  }
  if (!losses.total.defined()) throw InputError("", "", "every term of the skin loss has weight 0");
  return losses;
}

constexpr double kLeastPredictedWeight = 1e-8;
constexpr double kLeastRowSum = 1e-8;

// Column of the true weights for each predicted joint.
Tensor matching_columns(const Tensor& joints, const Tensor& predicted_joints) {
  const std::vector<skeleton_field::NearestJoints> nearest = skeleton_field::nearest_joints(
      nn::points_of<double>(predicted_joints, "predicted joints"), nn::points_of<double>(joints, "joints"));
  std::vector<std::int64_t> columns;
  for (const skeleton_field::NearestJoints& one : nearest) columns.push_back(one.joint);
  return torch::tensor(columns, torch::kInt64).to(joints.device());
}

}  // namespace

SkinLossOptions SkinLossOptions::compatible(const std::string& compatibility) {
  SkinLossOptions options;
  if (compatibility == "published") return options;
  if (compatibility != "paper")
    throw InputError("", "compatibility", "expected published or paper, found '" + compatibility + "'");
  options.kl_mean = SkinKlMean::kRows;
  options.epsilon = 0.0;
  return options;
}

SkinLosses skin_losses_from_log(const std::vector<Tensor>& log_predicted, const std::vector<Tensor>& target,
                                const SkinLossOptions& options) {
  const auto logarithm = [&](const Tensor& log_weights) {
    if (options.epsilon <= 0.0) return log_weights;
    return torch::logaddexp(log_weights, torch::full({}, std::log(options.epsilon), log_weights.options()));
  };
  return losses_of(log_predicted, target, options, logarithm, [](const Tensor& weights) { return weights.exp(); });
}

SkinLosses skin_losses(const std::vector<Tensor>& predicted, const std::vector<Tensor>& target,
                       const SkinLossOptions& options) {
  const auto logarithm = [&](const Tensor& weights) { return torch::log(weights + options.epsilon); };
  return losses_of(predicted, target, options, logarithm, [](const Tensor& weights) { return weights; });
}

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

Tensor joint_feature_loss(const Tensor& features, const Tensor& joint_features,
                          const skeleton_field::SkeletonTargets& targets, const Tensor& confidence) {
  const Tensor wanted = joint_features.detach().index_select(0, targets.joint);
  const Tensor error = (features - wanted).square();
  return confidence.defined() ? (confidence * error).mean() : error.mean();
}

}  // namespace anigen::skin_field
