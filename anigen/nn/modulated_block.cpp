#include "anigen/nn/modulated_block.h"

#include <utility>
#include <vector>

#include "anigen/nn/layer_norm.h"
#include "anigen/nn/modulated_rows.h"

namespace anigen::nn {
namespace {

// What one half of the block takes from the modulation, [B, C] each.
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

}  // namespace anigen::nn
