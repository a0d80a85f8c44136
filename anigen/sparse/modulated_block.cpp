#include "anigen/sparse/modulated_block.h"

#include "anigen/nn/layer_norm.h"
#include "anigen/sparse/item_modulation.h"

namespace anigen::sparse {
namespace {

SparseAttentionOptions modulated_self_attention(const SparseModulatedBlockOptions& options) {
  SparseAttentionOptions attention;
  attention.channels = options.channels;
  attention.num_heads = options.num_heads;
  attention.scope = options.scope;
  attention.qkv_bias = options.qkv_bias;
  attention.qk_rms_norm = options.qk_rms_norm;
  return attention;
}

SparseAttentionOptions modulated_cross_attention(const SparseModulatedBlockOptions& options) {
  TORCH_CHECK(options.context_channels > 0, "a block with cross attention needs the width of its context");
  SparseAttentionOptions attention = modulated_self_attention(options);
  attention.context_channels = options.context_channels;
  attention.scope = AttentionScope();
  attention.qk_rms_norm = options.qk_rms_norm_cross;
  return attention;
}

}  // namespace

SparseModulatedBlockImpl::SparseModulatedBlockImpl(const SparseModulatedBlockOptions& options) {
  attention_ = register_module("attn", SparseAttention(modulated_self_attention(options)));
  mlp_ = register_module("mlp", nn::FeedForward(options.channels, options.channels, options.mlp_ratio));
  if (!options.share_mod) modulation_ = register_module("adaLN_modulation", nn::Modulation(options.channels));
}

SparseTensor SparseModulatedBlockImpl::forward(const SparseTensor& x, const Tensor& mod) {
  const auto [attention, mlp] = item_modulations(modulation_, mod, x);
  const Tensor h = attention.add_gated(x.feats, attention_->forward(x.with(attention.modulate(x.feats))).feats);
  return x.with(mlp.add_gated(h, mlp_->forward(mlp.modulate(h))));
}

nn::Linear SparseModulatedBlockImpl::modulation() const { return linear_layer_of(modulation_); }

SparseModulatedCrossBlockImpl::SparseModulatedCrossBlockImpl(const SparseModulatedBlockOptions& options) {
  norm2_ = register_module("norm2", nn::AffineLayerNorm(options.channels, nn::kBlockNormEps));
  if (options.context_norm) {
    context_norm_ = register_module("context_norm", nn::AffineLayerNorm(options.context_channels, nn::kBlockNormEps));
  }
  self_attention_ = register_module("self_attn", SparseAttention(modulated_self_attention(options)));
  cross_attention_ = register_module("cross_attn", SparseAttention(modulated_cross_attention(options)));
  mlp_ = register_module("mlp", nn::FeedForward(options.channels, options.channels, options.mlp_ratio));
  if (!options.share_mod) modulation_ = register_module("adaLN_modulation", nn::Modulation(options.channels));
}

template <typename Cross>
SparseTensor SparseModulatedCrossBlockImpl::forward_with(const SparseTensor& x, const Tensor& mod, const Cross& cross) {
  const auto [attention, mlp] = item_modulations(modulation_, mod, x);
  Tensor h = attention.add_gated(x.feats, self_attention_->forward(x.with(attention.modulate(x.feats))).feats);
  h = h + cross(x.with(norm2_->forward(h))).feats;
  return x.with(mlp.add_gated(h, mlp_->forward(mlp.modulate(h))));
}

Tensor SparseModulatedCrossBlockImpl::normed_context(const Tensor& context) {
  return context_norm_.is_empty() ? context : context_norm_->forward(context);
}

SparseTensor SparseModulatedCrossBlockImpl::forward(const SparseTensor& x, const Tensor& mod,
                                                    const SparseTensor& context) {
  const SparseTensor seen = context.with(normed_context(context.feats));
  return forward_with(x, mod, [&](const SparseTensor& queries) { return cross_attention_->forward(queries, seen); });
}

SparseTensor SparseModulatedCrossBlockImpl::forward_dense(const SparseTensor& x, const Tensor& mod,
                                                          const Tensor& context) {
  const Tensor seen = normed_context(context);
  return forward_with(x, mod,
                      [&](const SparseTensor& queries) { return cross_attention_->forward_dense(queries, seen); });
}

nn::Linear SparseModulatedCrossBlockImpl::modulation() const { return linear_layer_of(modulation_); }

}  // namespace anigen::sparse
