#include "anigen/sparse/dual_stream_block.h"

#include "anigen/nn/layer_norm.h"
#include "anigen/sparse/item_modulation.h"

namespace anigen::sparse {
namespace {

SparseAttention stream_attention(const DualStreamBlockOptions& options, bool skeleton, std::int64_t context_channels,
                                 bool qk_rms_norm) {
  TORCH_CHECK(context_channels > 0, "a block with cross attention needs the width of its context");
  SparseAttentionOptions attention;
  attention.channels = skeleton ? options.channels_skl : options.channels;
  attention.num_heads = skeleton ? options.num_heads_skl : options.num_heads;
  attention.context_channels = context_channels;
  attention.qkv_bias = options.qkv_bias;
  attention.qk_rms_norm = qk_rms_norm;
  return SparseAttention(attention);
}

}  // namespace

DualStreamBlockImpl::DualStreamBlockImpl(const DualStreamBlockOptions& options) {
  const std::int64_t channels = options.channels, channels_skl = options.channels_skl;
  const std::int64_t context = options.context_channels;
  const bool norm = options.qk_rms_norm, norm_cross = options.qk_rms_norm_cross;
  norm2_ = register_module("norm2", nn::AffineLayerNorm(channels, nn::kBlockNormEps));
  norm2_skl_ = register_module("norm2_skl", nn::AffineLayerNorm(channels_skl, nn::kBlockNormEps));
  attention_ = register_module("attn", stream_attention(options, false, channels_skl, norm));
  attention_skl_ = register_module("attn_skl", stream_attention(options, true, channels, norm));
  context_attention_ = register_module("context_cross_attn", stream_attention(options, false, context, norm_cross));
  context_attention_skl_ =
      register_module("context_cross_attn_skl", stream_attention(options, true, context, norm_cross));
  mlp_ = register_module("mlp", nn::FeedForward(channels, channels, options.mlp_ratio));
  mlp_skl_ = register_module("mlp_skl", nn::FeedForward(channels_skl, channels_skl, options.mlp_ratio));
  if (options.share_mod) return;
  modulation_ = register_module("adaLN_modulation", nn::Modulation(channels));
  modulation_skl_ = register_module("adaLN_modulation_skl", nn::Modulation(channels_skl));
}

DualStreamBlockImpl::Output DualStreamBlockImpl::forward(const SparseTensor& x, const SparseTensor& x_skl,
                                                         const Tensor& mod, const Tensor& mod_skl,
                                                         const Tensor& context) {
  const auto [attention, mlp] = item_modulations(modulation_, mod, x);
  const auto [attention_skl, mlp_skl] = item_modulations(modulation_skl_, mod_skl, x_skl);
  const SparseTensor seen = x_skl.with(attention_skl.modulate(x_skl.feats));
  const SparseTensor mixed = attention_->forward(x.with(attention.modulate(x.feats)), seen);
  const SparseTensor mixed_skl = attention_skl_->forward(seen, mixed);  // the shape stream as it is after its attention
  Tensor h = attention.add_gated(x.feats, mixed.feats);
  Tensor h_skl = attention_skl.add_gated(x_skl.feats, mixed_skl.feats);
  h = h + context_attention_->forward_dense(x.with(norm2_->forward(h)), context).feats;
  h_skl = h_skl + context_attention_skl_->forward_dense(x_skl.with(norm2_skl_->forward(h_skl)), context).feats;
  return {x.with(mlp.add_gated(h, mlp_->forward(mlp.modulate(h)))),
          x_skl.with(mlp_skl.add_gated(h_skl, mlp_skl_->forward(mlp_skl.modulate(h_skl))))};
}

nn::Linear DualStreamBlockImpl::modulation() const { return linear_layer_of(modulation_); }
nn::Linear DualStreamBlockImpl::modulation_skl() const { return linear_layer_of(modulation_skl_); }

}  // namespace anigen::sparse
