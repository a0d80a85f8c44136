#include "anigen/nn/blocks.h"

#include <utility>
#include <vector>

#include "anigen/nn/kernels/rows.h"
#include "anigen/nn/norms.h"

namespace anigen::nn {

FeedForwardImpl::FeedForwardImpl(std::int64_t in_channels, std::int64_t out_channels, double mlp_ratio) {
  const auto hidden = static_cast<std::int64_t>(static_cast<double>(in_channels) * mlp_ratio);
  mlp_ = register_module("mlp", Mlp(in_channels, hidden, out_channels));
}

namespace {

AttentionOptions attention_options(std::int64_t channels, std::int64_t num_heads) {
  AttentionOptions options;
  options.channels = channels;
  options.num_heads = num_heads;
  return options;
}

}  // namespace

TransformerBlockImpl::TransformerBlockImpl(std::int64_t channels, std::int64_t num_heads, double mlp_ratio,
                                           const std::string& attention_name) {
  attention_ = register_module(attention_name, SelfAttention(attention_options(channels, num_heads)));
  mlp_ = register_module("mlp", FeedForward(channels, channels, mlp_ratio));
}

Tensor TransformerBlockImpl::forward(const Tensor& x, const Ragged& items) {
  const Tensor mixed = x + attention_->forward(layer_norm(x), items);
  return mixed + mlp_->forward(layer_norm(mixed));
}

CrossBlockImpl::CrossBlockImpl(std::int64_t channels, std::int64_t num_heads, double mlp_ratio) {
  attention_ = register_module("cross_attn", CrossAttention(attention_options(channels, num_heads)));
  mlp_ = register_module("mlp", FeedForward(channels, channels, mlp_ratio));
}

Tensor CrossBlockImpl::forward(const Tensor& x, const Ragged& items, const Tensor& context,
                               const Ragged& context_items) {
  const Tensor mixed = x + attention_->forward(layer_norm(x), items, context, context_items);
  return mixed + mlp_->forward(layer_norm(mixed));
}

namespace {

// Modulation of one half of the block, [B, C] each.
struct AdaptiveNorm {
  Ragged items;  // of the same length
  Tensor shift, scale, gate;

  // @param x [B, N, C]
  Tensor modulate(const Tensor& x) const {
    return modulated_norm(x.flatten(0, 1), items, shift, scale, kBlockNormEps).view(x.sizes());
  }
  Tensor add_gated(const Tensor& x, const Tensor& result) const {
    return nn::add_gated(x.flatten(0, 1), items, gate, result.flatten(0, 1)).view(x.sizes());
  }
};

// [B, 6C], or with a layer [B, C] → shift, scale, gate of the attention and of the MLP. @param x [B, N, C]
std::pair<AdaptiveNorm, AdaptiveNorm> adaptive_norms(Modulation& layer, const Tensor& mod, const Tensor& x) {
  TORCH_CHECK(x.dim() == 3, "a modulated block: input ", x.sizes());
  const Tensor rows = layer.is_empty() ? mod : layer->forward(mod);
  TORCH_CHECK(rows.dim() == 2 && rows.size(0) == x.size(0) && rows.size(1) == 6 * x.size(2), "modulation ",
              rows.sizes(), " of a block with input ", x.sizes());
  const std::vector<Tensor> parts = rows.chunk(6, -1);
  const Ragged items(std::vector<std::int64_t>(static_cast<std::size_t>(x.size(0)), x.size(1)));
  return {{items, parts[0], parts[1], parts[2]}, {items, parts[3], parts[4], parts[5]}};
}

DenseAttentionOptions modulated_self(const ModulatedBlockOptions& options) {
  DenseAttentionOptions attention;
  attention.channels = options.channels;
  attention.num_heads = options.num_heads;
  attention.qkv_bias = options.qkv_bias;
  attention.qk_rms_norm = options.qk_rms_norm;
  attention.lora_qkv = attention.lora_out = options.lora_self;
  return attention;
}

DenseAttentionOptions modulated_cross(const ModulatedBlockOptions& options) {
  TORCH_CHECK(options.context_channels > 0, "a block with cross attention needs the width of its context");
  DenseAttentionOptions attention = modulated_self(options);
  attention.context_channels = options.context_channels;
  attention.qk_rms_norm = options.qk_rms_norm_cross;
  attention.lora_qkv = attention.lora_out = options.lora_cross;
  return attention;
}

Linear linear_of(const Modulation& modulation) {
  if (modulation.is_empty()) return nullptr;
  return modulation->linear;
}

}  // namespace

ModulationImpl::ModulationImpl(std::int64_t channels, std::int64_t values) {
  linear = register_module("1", Linear(channels, values));
}

Tensor ModulationImpl::forward(const Tensor& mod) { return linear->forward(torch::silu(mod)); }

ModulatedCrossBlockImpl::ModulatedCrossBlockImpl(const ModulatedBlockOptions& options) {
  norm2_ = register_module("norm2", AffineLayerNorm(options.channels, kBlockNormEps));
  if (options.context_norm) {
    context_norm_ = register_module("context_norm", AffineLayerNorm(options.context_channels, kBlockNormEps));
  }
  self_attention_ = register_module("self_attn", DenseAttention(modulated_self(options)));
  cross_attention_ = register_module("cross_attn", DenseAttention(modulated_cross(options)));
  mlp_ = register_module("mlp", FeedForward(options.channels, options.channels, options.mlp_ratio));
  if (!options.share_mod) modulation_ = register_module("adaLN_modulation", Modulation(options.channels));
}

Tensor ModulatedCrossBlockImpl::forward(const Tensor& x, const Tensor& mod, const Tensor& context) {
  const auto [attention, mlp] = adaptive_norms(modulation_, mod, x);
  Tensor h = attention.add_gated(x, self_attention_->forward(attention.modulate(x)));
  const Tensor normed = context_norm_.is_empty() ? context : context_norm_->forward(context);
  h = h + cross_attention_->forward(norm2_->forward(h), normed);
  return mlp.add_gated(h, mlp_->forward(mlp.modulate(h)));
}

Linear ModulatedCrossBlockImpl::modulation() const { return linear_of(modulation_); }

ModulatedBlockImpl::ModulatedBlockImpl(const ModulatedBlockOptions& options) {
  attention_ = register_module("attn", DenseAttention(modulated_self(options)));
  mlp_ = register_module("mlp", FeedForward(options.channels, options.channels, options.mlp_ratio));
  if (!options.share_mod) modulation_ = register_module("adaLN_modulation", Modulation(options.channels));
}

Tensor ModulatedBlockImpl::forward(const Tensor& x, const Tensor& mod) {
  const auto [attention, mlp] = adaptive_norms(modulation_, mod, x);
  const Tensor h = attention.add_gated(x, attention_->forward(attention.modulate(x)));
  return mlp.add_gated(h, mlp_->forward(mlp.modulate(h)));
}

Linear ModulatedBlockImpl::modulation() const { return linear_of(modulation_); }

namespace {

std::int64_t out_width(const DenseBlockOptions& options) {
  return options.out_channels > 0 ? options.out_channels : options.channels;
}

DenseAttentionOptions block_self(const DenseBlockOptions& options) {
  DenseAttentionOptions attention;
  attention.channels = options.channels;
  attention.num_heads = options.num_heads;
  attention.qkv_bias = options.qkv_bias;
  attention.qk_rms_norm = options.qk_rms_norm;
  return attention;
}

DenseAttentionOptions block_cross(const DenseBlockOptions& options) {
  TORCH_CHECK(options.context_channels > 0, "a block with cross attention needs the width of its context");
  DenseAttentionOptions attention = block_self(options);
  attention.context_channels = options.context_channels;
  attention.qk_rms_norm = options.qk_rms_norm_cross;
  return attention;
}

}  // namespace

BlockNorm::BlockNorm(torch::nn::Module& block, const char* name, std::int64_t channels, bool affine) {
  if (affine) affine_ = block.register_module(name, AffineLayerNorm(channels, kBlockNormEps));
}

Tensor BlockNorm::operator()(const Tensor& x) { return affine_.is_empty() ? layer_norm(x) : affine_->forward(x); }

BlockOutput::BlockOutput(torch::nn::Module& block, const std::string& mlp, const DenseBlockOptions& options) {
  const std::int64_t channels = options.channels, out = out_width(options);
  mlp_ = block.register_module(mlp, FeedForward(channels, out, options.mlp_ratio));
  if (out != channels) residual_ = block.register_module("res_" + mlp, FeedForward(channels, out, 1.0));
}

Tensor BlockOutput::operator()(const Tensor& x, const Tensor& normed) {
  return (residual_.is_empty() ? x : residual_->forward(x)) + mlp_->forward(normed);
}

DenseBlockImpl::DenseBlockImpl(const DenseBlockOptions& options) {
  norm1_ = BlockNorm(*this, "norm1", options.channels, options.affine_norms);
  norm2_ = BlockNorm(*this, "norm2", options.channels, options.affine_norms);
  attention_ = register_module("attn", DenseAttention(block_self(options)));
  output_ = BlockOutput(*this, "mlp", options);
}

Tensor DenseBlockImpl::forward(const Tensor& x) {
  const Tensor mixed = x + attention_->forward(norm1_(x));
  return output_(mixed, norm2_(mixed));
}

DenseCrossBlockImpl::DenseCrossBlockImpl(const DenseBlockOptions& options) {
  if (options.self_attention) norm1_ = BlockNorm(*this, "norm1", options.channels, options.affine_norms);
  norm2_ = BlockNorm(*this, "norm2", options.channels, options.affine_norms);
  norm3_ = BlockNorm(*this, "norm3", options.channels, options.affine_norms);
  if (options.self_attention) self_attention_ = register_module("self_attn", DenseAttention(block_self(options)));
  cross_attention_ = register_module("cross_attn", DenseAttention(block_cross(options)));
  output_ = BlockOutput(*this, "mlp", options);
}

Tensor DenseCrossBlockImpl::forward(const Tensor& x, const Tensor& context) {
  Tensor mixed = self_attention_.is_empty() ? x : x + self_attention_->forward(norm1_(x));
  mixed = mixed + cross_attention_->forward(norm2_(mixed), context);
  return output_(mixed, norm3_(mixed));
}

SkinCrossBlockImpl::SkinCrossBlockImpl(const DenseBlockOptions& options) {
  norm1_ = BlockNorm(*this, "norm1", options.channels, options.affine_norms);
  norm2_ = BlockNorm(*this, "norm2", options.channels, options.affine_norms);
  norm3_ = BlockNorm(*this, "norm3", options.channels, options.affine_norms);
  attention_ = register_module("joint_attn", DenseAttention(block_self(options)));
  to_values_ = register_module("to_v", Linear(options.channels, options.channels));
  output_ = BlockOutput(*this, "mlp", options);
  joint_output_ = BlockOutput(*this, "joint_mlp", options);
}

SkinCrossBlockImpl::Output SkinCrossBlockImpl::forward(const Tensor& vertices, const Tensor& joints,
                                                       const Tensor& skin) {
  const Tensor mixed = vertices + torch::matmul(skin, to_values_->forward(norm1_(joints)));
  const Tensor attended = joints + attention_->forward(norm3_(joints));
  return {output_(mixed, norm2_(mixed)), joint_output_(joints, attended)};
}

}  // namespace anigen::nn
