#include "anigen/skin_correction/network.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <string>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/nn/norms.h"

namespace anigen::skin_correction {

namespace {

constexpr std::int64_t kPairs = rigging::kSkinPairFeatures, kAssets = rigging::kSkinAssetFeatures;
constexpr double kMissing = -1e9;  // score and logit of a candidate that is not there
constexpr double kMostSharpening = 3.0;
constexpr double kFirstMixture = 2.0;  // logit of the share of heat, 0.88: of the two by far the better on real rigs

Tensor scaled_features(const Tensor& pairs) {
  static const std::array<Tensor, 2> scales = [] {
    const auto& of = rigging::skin_feature_scales();
    Tensor middle = torch::empty({kPairs}), factor = torch::empty({kPairs});
    for (std::size_t f = 0; f < of.size(); ++f) {
      middle.data_ptr<float>()[f] = of[f].middle;
      factor.data_ptr<float>()[f] = 1.0F / of[f].spread;
    }
    return std::array<Tensor, 2>{middle, factor};
  }();
  return (pairs - scales[0].to(pairs.device())) * scales[1].to(pairs.device());
}

}  // namespace

void SkinCorrectionOptions::fields(ConfigFields& f) {
  f("feature_version", feature_version, {1, 1'000'000});
  f("candidates", candidates, {1, 256});
  f("geovoxel_resolution", geovoxel_resolution, {2, 512});
  f("members", members, {1, 256});
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

SkinCorrectorImpl::SkinCorrectorImpl(const SkinCorrectionOptions& options) : candidates_(options.candidates) {
  const std::int64_t width = options.width;
  pair_ = register_module("pair", nn::Mlp(kPairs, width, width));
  asset_ = register_module("asset", nn::Mlp(kAssets, width, width));
  nn::AttentionOptions attention;
  attention.channels = width;
  attention.num_heads = options.num_heads;
  for (std::int64_t b = 0; b < options.num_blocks; ++b) {
    const std::string name = std::to_string(b);
    attention_.push_back(register_module("attention_" + name, TokenAttention(attention)));
    mlps_.push_back(register_module("mlp_" + name, nn::FeedForward(width, width, options.mlp_ratio)));
  }
  correction_ = register_module("correction", nn::Linear(width, 1));
  if (options.sharpening) sharpening_ = register_module("sharpening", nn::Linear(width, 1));
  mixture_ = register_parameter("mixture", torch::full({1}, kFirstMixture));
}

void SkinCorrectorImpl::start_at_classical_weights() {
  nn::zero_parameters(*correction_);
  if (!sharpening_.is_empty()) nn::zero_parameters(*sharpening_);
}

Tensor SkinCorrectorImpl::forward(const Tensor& scaled, const Tensor& heat, const Tensor& geodesic,
                                  const Tensor& assets, const Tensor& present) {
  const std::int64_t rows = scaled.size(0), count = candidates_;
  const Tensor share = mixture_.sigmoid();
  const Tensor base = (share * heat + (1.0 - share) * geodesic + rigging::kClassicalFloor).log();
  const Tensor missing = present.logical_not();
  const Tensor mask = torch::cat({missing, missing.new_zeros({rows, 1})}, 1).to(scaled.scalar_type()) * kMissing;
  Tensor tokens = torch::cat({pair_->forward(scaled), asset_->forward(assets).unsqueeze(1)}, 1);
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

SkinCorrectionImpl::SkinCorrectionImpl(const SkinCorrectionOptions& options, nn::Init init) : options_(options) {
  options_.validate();
  for (std::int64_t m = 0; m < options_.members; ++m)
    members_.push_back(register_module("member_" + std::to_string(m), SkinCorrector(options_)));
  if (init != nn::Init::kPublished) return;
  nn::xavier_uniform_linears(*this);
  for (SkinCorrector& member : members_) member->start_at_classical_weights();
}

Tensor SkinCorrectionImpl::of_members(const Tensor& pairs, const Tensor& assets, const Tensor& present,
                                      const Tensor& noise) {
  const std::int64_t rows = pairs.size(0), count = options_.candidates;
  if (pairs.dim() != 3 || pairs.size(1) != count || pairs.size(2) != kPairs) {
    throw InputError("", "pairs",
                     "expected shape [N, " + std::to_string(count) + ", " + std::to_string(kPairs) + "], got " +
                         nn::shape_text(pairs));
  }
  nn::require_matrix(assets, rows, kAssets, "assets");
  nn::require_matrix(present, rows, count, "present");
  const Tensor heat = classical_weights(pairs, rigging::kHeatLog);
  const Tensor geodesic = classical_weights(pairs, rigging::kGeodesicLog);
  Tensor scaled = scaled_features(pairs);
  if (noise.defined()) scaled = scaled + noise;
  std::vector<Tensor> answers;
  for (SkinCorrector& member : members_) answers.push_back(member->forward(scaled, heat, geodesic, assets, present));
  return torch::stack(answers);
}

Tensor SkinCorrectionImpl::forward(const Tensor& pairs, const Tensor& assets, const Tensor& present) {
  const Tensor answers = of_members(pairs, assets, present);
  return answers.logsumexp(0) - std::log(static_cast<double>(answers.size(0)));
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
