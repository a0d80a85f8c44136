#include "anigen/skin_correction/network.h"

#include <algorithm>
#include <string>

#include "anigen/core/error.h"
#include "anigen/nn/norms.h"

namespace anigen::skin_correction {

namespace {

constexpr std::int64_t kPairs = rigging::kSkinPairFeatures, kAssets = rigging::kSkinAssetFeatures;
constexpr std::int64_t kLogs = rigging::kGeodesicAround + 1;  // features that are logarithms of classical weights
constexpr double kMissing = -1e9;                             // score and logit of a candidate that is not there
constexpr double kMostSharpening = 3.0;
constexpr double kFirstMixture = 2.0;  // logit of the share of heat, 0.88: of the two by far the better on real rigs

// Logarithms of weights from −9.2 to 0 are brought to the range of the other features.
Tensor scaled_features(const Tensor& pairs) {
  const Tensor logs = 0.4 * (pairs.narrow(2, 0, kLogs) + 4.0);
  return torch::cat({logs, pairs.narrow(2, kLogs, kPairs - kLogs)}, 2);
}

}  // namespace

void SkinCorrectionOptions::fields(ConfigFields& f) {
  f("feature_version", feature_version, {1, 1'000'000});
  f("candidates", candidates, {1, 256});
  f("geovoxel_resolution", geovoxel_resolution, {2, 512});
  f("width", width, {8, 4096});
  f("num_blocks", num_blocks, {0, 64});
  f("num_heads", num_heads, {1, 256});
  f("mlp_ratio", mlp_ratio, {0.1, 64.0});
  f("sharpening", sharpening);
  f("smoothing", smoothing, {0.0, 1.0});
}

void SkinCorrectionOptions::validate(const std::string& file, const std::string& pointer) const {
  const OptionCheck check{file, pointer};
  check(feature_version == rigging::kSkinFeatureVersion, "feature_version",
        "must be " + std::to_string(rigging::kSkinFeatureVersion) +
            ", the version of the features that this build computes");
  check.heads("num_heads", num_heads, width);
}

rigging::SkinFeatureOptions SkinCorrectionOptions::features() const {
  return {static_cast<std::size_t>(candidates), static_cast<int>(geovoxel_resolution)};
}

Tensor TokenAttentionImpl::forward(const Tensor& x, const Tensor& mask) {
  const std::vector<Tensor> parts = heads_of(to_qkv_->forward(x), 3);
  const auto heads_first = [](const Tensor& part) { return part.transpose(1, 2); };
  const Tensor seen = nn::attend(heads_first(parts[0]), heads_first(parts[1]), heads_first(parts[2]), mask);
  return to_out_->forward(seen.transpose(1, 2).flatten(2));
}

SkinCorrectionImpl::SkinCorrectionImpl(const SkinCorrectionOptions& options, nn::Init init) : options_(options) {
  options_.validate();
  const std::int64_t width = options_.width;
  pair_ = register_module("pair", nn::Mlp(kPairs, width, width));
  asset_ = register_module("asset", nn::Mlp(kAssets, width, width));
  nn::AttentionOptions attention;
  attention.channels = width;
  attention.num_heads = options_.num_heads;
  for (std::int64_t b = 0; b < options_.num_blocks; ++b) {
    const std::string name = std::to_string(b);
    attention_.push_back(register_module("attention_" + name, TokenAttention(attention)));
    mlps_.push_back(register_module("mlp_" + name, nn::FeedForward(width, width, options_.mlp_ratio)));
  }
  correction_ = register_module("correction", nn::Linear(width, 1));
  if (options_.sharpening) sharpening_ = register_module("sharpening", nn::Linear(width, 1));
  mixture_ = register_parameter("mixture", torch::full({1}, kFirstMixture));
  if (init != nn::Init::kPublished) return;
  nn::xavier_uniform_linears(*this);
  nn::zero_parameters(*correction_);
  if (!sharpening_.is_empty()) nn::zero_parameters(*sharpening_);
}

Tensor SkinCorrectionImpl::forward(const Tensor& pairs, const Tensor& assets, const Tensor& present) {
  const std::int64_t rows = pairs.size(0), count = options_.candidates;
  if (pairs.dim() != 3 || pairs.size(1) != count || pairs.size(2) != kPairs) {
    throw InputError("", "pairs",
                     "expected shape [N, " + std::to_string(count) + ", " + std::to_string(kPairs) + "], got " +
                         nn::shape_text(pairs));
  }
  nn::require_matrix(assets, rows, kAssets, "assets");
  nn::require_matrix(present, rows, count, "present");
  const Tensor share = mixture_.sigmoid();
  const Tensor mixed = share * classical_weights(pairs, rigging::kHeatLog) +
                       (1.0 - share) * classical_weights(pairs, rigging::kGeodesicLog);
  const Tensor base = (mixed + rigging::kClassicalFloor).log();
  const Tensor missing = present.logical_not();
  const Tensor mask = torch::cat({missing, missing.new_zeros({rows, 1})}, 1).to(pairs.scalar_type()) * kMissing;
  Tensor tokens = torch::cat({pair_->forward(scaled_features(pairs)), asset_->forward(assets).unsqueeze(1)}, 1);
  for (std::size_t b = 0; b < attention_.size(); ++b) {
    tokens = tokens + attention_[b]->forward(nn::layer_norm(tokens), mask.view({rows, 1, 1, count + 1}));
    tokens = tokens + mlps_[b]->forward(nn::layer_norm(tokens));
  }
  tokens = nn::layer_norm(tokens);
  Tensor logits = base + correction_->forward(tokens.narrow(1, 0, count)).squeeze(2);
  if (!sharpening_.is_empty()) {
    const Tensor power = sharpening_->forward(tokens.select(1, count)).clamp(-kMostSharpening, kMostSharpening);
    logits = logits * power.exp();
  }
  return logits.masked_fill(missing, kMissing).log_softmax(1);
}

Tensor strongest_weights(const Tensor& weights, std::int64_t most) {
  const auto [values, places] = weights.topk(std::min(most, weights.size(1)), 1);
  const Tensor kept = torch::zeros_like(weights).scatter(1, places, values);
  return kept / kept.sum(1, true).clamp_min(rigging::kClassicalFloor);
}

Tensor classical_weights(const Tensor& pairs, rigging::SkinPairFeature feature) {
  return (pairs.select(2, static_cast<std::int64_t>(feature)).exp() - rigging::kClassicalFloor).clamp_min(0.0);
}

}  // namespace anigen::skin_correction
