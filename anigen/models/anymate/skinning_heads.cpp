#include "anigen/models/anymate/skinning_heads.h"

#include <algorithm>
#include <string>

#include "anigen/models/anymate/checks.h"
#include "anigen/models/anymate/init.h"
#include "anigen/nn/module_list.h"

namespace anigen::models::anymate {
namespace {

constexpr std::int64_t kPointsAtOnce = 8192;  // whose hidden layer of four times the width is the largest tensor

}  // namespace

CrossSkinningImpl::CrossSkinningImpl(const HeadOptions& options, std::int64_t layers, bool separate, nn::Init init)
    : options_(options), embedding_(*this, options, separate) {
  require(layers > 0, "layers", "must be positive");
  const std::int64_t width = options.width;
  for (std::int64_t i = 0; i < layers; ++i) {
    cross_attn_.emplace_back(width, options.heads, options.qkv_bias);
    cross_attn_joint_.emplace_back(width, options.heads, options.qkv_bias);
  }
  register_module("cross_attn", nn::module_list(cross_attn_));
  register_module("cross_attn_joint", nn::module_list(cross_attn_joint_));
  q_proj_ = register_module("q_proj", nn::Linear(width, width));
  k_proj_ = register_module("k_proj", nn::Linear(width, width));
  ln_1_ = register_module("ln_1", nn::AffineLayerNorm(width, kNormEps));
  ln_2_ = register_module("ln_2", nn::AffineLayerNorm(width, kNormEps));
  if (init == nn::Init::kNone) return;
  default_layers(*this);
  normal_blocks(*this, options.init_scale);
}

std::vector<Tensor> CrossSkinningImpl::bone_stream(const Tensor& bones, const Tensor& latents, const KeyMask& keys) {
  std::vector<Tensor> tokens;
  Tensor x = embedding_.bones(bones);
  for (std::size_t i = 0; i < cross_attn_.size(); ++i) {
    tokens.push_back(cross_attn_[i](x, latents));
    x = cross_attn_joint_[i](tokens.back(), tokens.back(), keys);
  }
  tokens.push_back(x);
  return tokens;
}

Tensor CrossSkinningImpl::forward(const SkinningInput& input, std::int64_t chunk) {
  require(chunk >= 0, "chunk", "must not be negative");
  const Tensor bones = checked_bones(input, options_.width);
  const KeyMask keys = input.mask.defined() ? KeyMask(input.mask) : KeyMask();
  const std::vector<Tensor> tokens = bone_stream(bones, input.latents, keys);
  const Tensor columns = q_proj_(ln_2_(tokens.back())).transpose(1, 2);
  if (chunk == 0)
    chunk = torch::GradMode::is_enabled() ? std::max<std::int64_t>(input.points.size(1), 1) : kPointsAtOnce;
  std::vector<Tensor> parts;
  for (const Tensor& part : input.points.split(chunk, 1)) {
    Tensor x = embedding_.points(part);
    for (std::size_t i = 0; i < cross_attn_.size(); ++i) {
      x = cross_attn_[i](x, input.latents);
      x = cross_attn_joint_[i](x, tokens[i], keys);
    }
    parts.push_back(torch::matmul(k_proj_(ln_1_(x)), columns));
  }
  return masked_bone_logits(torch::cat(parts, 1), input.mask);
}

ConcatSkinningImpl::ConcatSkinningImpl(const HeadOptions& head, const ConcatSkinningOptions& options, nn::Init init)
    : head_(head), options_(options) {
  require(options.concat_num > 0, "concat_num", "must be positive");
  const std::int64_t width = head.width;
  self_attn_ = register_module("self_attn", ResidualStack(options.layers, width, head.heads, head.qkv_bias));
  embedding_ = SkinningEmbedding(*this, head, options.separate);
  output_proj_joints_ = register_module("output_proj_joints", nn::Linear(width, width));
  output_proj_points_ = register_module("output_proj_points", nn::Linear(width, width));
  layer_norm_ = register_module("layer_norm", nn::AffineLayerNorm(width, kNormEps));
  if (init == nn::Init::kNone) return;
  default_layers(*this);
  normal_blocks(*this, head.init_scale);
}

Tensor ConcatSkinningImpl::run_logits(const Tensor& points, const Tensor& bones, const Tensor& latents,
                                      const Tensor& masks) {
  const std::int64_t run = options_.concat_num, items = points.size(0), runs = points.size(1) / run;
  const std::int64_t count = bones.size(1);
  KeyMask keys;
  if (masks.defined()) {
    const Tensor others = torch::ones({items * runs, run + latents.size(1)}, masks.options());
    keys = KeyMask(torch::cat({masks.reshape({items * runs, count}), others}, 1));
  }
  // Sequences item after item, [B · runs, …].
  const Tensor of_runs = points.reshape({items * runs, run, points.size(2)});
  const Tensor sequence =
      torch::cat({bones.repeat_interleave(runs, 0), of_runs, latents.repeat_interleave(runs, 0)}, 1);
  const Tensor x = layer_norm_(self_attn_(sequence, keys).slice(1, 0, count + run));
  const Tensor columns = output_proj_joints_(x.slice(1, 0, count)), rows = output_proj_points_(x.slice(1, count));
  return torch::matmul(rows, columns.transpose(1, 2)).view({items, runs * run, count});
}

Tensor ConcatSkinningImpl::forward(const SkinningInput& input, std::int64_t chunk) {
  const Tensor bones = embedding_.bones(checked_bones(input, head_.width));
  const std::int64_t run = options_.concat_num, items = bones.size(0), points = input.points.size(1);
  const std::int64_t at_once = chunk == 0 ? run : chunk;
  require(at_once > 0 && at_once % run == 0, "chunk", "must be a multiple of concat_num, " + std::to_string(run));
  require(points > 0 && points % run == 0, "points",
          std::to_string(points) + " points are not a whole number of runs of " + std::to_string(run));
  Tensor masks;  // [B, runs, K]
  if (input.mask.defined()) {
    const Tensor tiled = input.mask.repeat({points / run, 1}).view({items, points / run, -1});
    masks = options_.tiled_masks ? tiled : input.mask.unsqueeze(1).expand_as(tiled);
  }
  std::vector<Tensor> parts;
  for (std::int64_t first = 0; first < points; first += at_once) {
    const std::int64_t size = std::min(at_once, points - first);
    const Tensor tokens = embedding_.points(input.points.narrow(1, first, size));
    const Tensor own = masks.defined() ? masks.narrow(1, first / run, size / run) : masks;
    parts.push_back(run_logits(tokens, bones, input.latents, own));
  }
  return masked_bone_logits(torch::cat(parts, 1), input.mask);
}

}  // namespace anigen::models::anymate
