#include "anigen/skin_field/loss.h"

#include <cmath>
#include <vector>

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

// Sums over the assets of the terms that count.
struct Sums {
  Tensor kl, l1, l2;

  void add(const Tensor& log_predicted, const Tensor& predicted, const Tensor& target, const SkinLossOptions& options) {
    if (log_predicted.defined()) accumulate(kl, kl_divergence(log_predicted, target, options.kl_mean));
    if (!predicted.defined()) return;
    const Tensor difference = predicted - target;
    if (options.lambda_l1_skin != 0.0) accumulate(l1, difference.abs().mean());
    if (options.lambda_l2_skin != 0.0) accumulate(l2, difference.square().mean());
  }

  static void accumulate(Tensor& sum, const Tensor& term) { sum = sum.defined() ? sum + term : term; }
};

SkinLosses finished(const Sums& sums, std::size_t assets, const SkinLossOptions& options) {
  SkinLosses losses;
  const auto count = static_cast<double>(assets);
  const auto add = [&](const Tensor& sum, double weight, Tensor& mean) {
    if (!sum.defined()) return;
    mean = sum / count;
    losses.total = losses.total.defined() ? losses.total + weight * mean : weight * mean;
  };
  add(sums.kl, options.lambda_kl_skin, losses.kl);
  add(sums.l1, options.lambda_l1_skin, losses.l1);
  add(sums.l2, options.lambda_l2_skin, losses.l2);
  if (!losses.total.defined()) throw InputError("", "", "every term of the skin loss has weight 0");
  return losses;
}

bool needs_weights(const SkinLossOptions& options) {
  return options.lambda_l1_skin != 0.0 || options.lambda_l2_skin != 0.0;
}

}  // namespace

SkinLossOptions SkinLossOptions::compatible(const std::string& compatibility) {
  SkinLossOptions options;
  if (compatibility == "published") return options;
  if (compatibility != "paper") {
    throw InputError("", "compatibility", "expected published or paper, found '" + compatibility + "'");
  }
  options.kl_mean = SkinKlMean::kRows;
  options.epsilon = 0.0;
  return options;
}

SkinLosses skin_losses_from_log(const std::vector<Tensor>& log_predicted, const std::vector<Tensor>& target,
                                const SkinLossOptions& options) {
  check_shapes(log_predicted, target);
  Sums sums;
  for (std::size_t i = 0; i < target.size(); ++i) {
    Tensor log_weights;
    if (options.lambda_kl_skin != 0.0) {
      log_weights = log_predicted[i];
      if (options.epsilon > 0.0) {
        log_weights = torch::logaddexp(log_weights, torch::full({}, std::log(options.epsilon), log_weights.options()));
      }
    }
    const Tensor weights = needs_weights(options) ? log_predicted[i].exp() : Tensor();
    sums.add(log_weights, weights, target[i], options);
  }
  return finished(sums, target.size(), options);
}

SkinLosses skin_losses(const std::vector<Tensor>& predicted, const std::vector<Tensor>& target,
                       const SkinLossOptions& options) {
  check_shapes(predicted, target);
  Sums sums;
  for (std::size_t i = 0; i < target.size(); ++i) {
    const Tensor log_weights = options.lambda_kl_skin != 0.0 ? torch::log(predicted[i] + options.epsilon) : Tensor();
    sums.add(log_weights, needs_weights(options) ? predicted[i] : Tensor(), target[i], options);
  }
  return finished(sums, target.size(), options);
}

namespace {

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
