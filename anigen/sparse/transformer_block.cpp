#include "anigen/sparse/transformer_block.h"

#include "anigen/nn/layer_norm.h"

namespace anigen::sparse {
namespace {

SparseAttentionOptions block_self_attention(const SparseBlockOptions& options) {
  SparseAttentionOptions attention;
  attention.channels = options.channels;
  attention.num_heads = options.num_heads;
  attention.scope = options.scope;
  attention.qkv_bias = options.qkv_bias;
  attention.qk_rms_norm = options.qk_rms_norm;
  return attention;
}

SparseAttentionOptions block_cross_attention(const SparseBlockOptions& options, std::int64_t context_channels) {
  TORCH_CHECK(context_channels > 0, "a block with cross attention needs the width of its context");
  SparseAttentionOptions attention = block_self_attention(options);
  attention.context_channels = context_channels;
  attention.scope = options.cross_scope;
  attention.qk_rms_norm = options.qk_rms_norm_cross;
  return attention;
}

nn::FeedForward block_mlp(const SparseBlockOptions& options) {
  return nn::FeedForward(options.channels, options.channels, options.mlp_ratio);
}

}  // namespace

SparseTransformerBlockImpl::SparseTransformerBlockImpl(const SparseBlockOptions& options) {
  norm1_ = nn::BlockNorm(*this, "norm1", options.channels, options.affine_norms);
  norm2_ = nn::BlockNorm(*this, "norm2", options.channels, options.affine_norms);
  attention_ = register_module(options.attention_name, SparseAttention(block_self_attention(options)));
  mlp_ = register_module("mlp", block_mlp(options));
}

SparseTensor SparseTransformerBlockImpl::forward(const SparseTensor& x) {
  const Tensor h = x.feats + attention_->forward(x.with(norm1_(x.feats))).feats;
  return x.with(h + mlp_->forward(norm2_(h)));
}

SparseCrossBlockImpl::SparseCrossBlockImpl(const SparseBlockOptions& options) : norm_context_(options.norm_context) {
  TORCH_CHECK(options.context_channels.size() == 1, "a cross block has one context, not ",
              options.context_channels.size());
  const std::int64_t context = options.context_channels[0];
  norm1_ = nn::BlockNorm(*this, "norm1", options.channels, options.affine_norms);
  norm2_ = nn::BlockNorm(*this, "norm2", options.channels, options.affine_norms);
  norm3_ = nn::BlockNorm(*this, "norm3", options.channels, options.affine_norms);
  if (norm_context_) norm4_ = nn::BlockNorm(*this, "norm4", context, options.affine_norms);
  self_attention_ = register_module("self_attn", SparseAttention(block_self_attention(options)));
  cross_attention_ = register_module("cross_attn", SparseAttention(block_cross_attention(options, context)));
  mlp_ = register_module("mlp", block_mlp(options));
}

SparseTensor SparseCrossBlockImpl::forward(const SparseTensor& x, const SparseTensor& context) {
  const SparseTensor seen = norm_context_ ? context.with(norm4_(context.feats)) : context;
  Tensor h = x.feats + self_attention_->forward(x.with(norm1_(x.feats))).feats;
  h = h + cross_attention_->forward(x.with(norm2_(h)), seen).feats;
  return x.with(h + mlp_->forward(norm3_(h)));
}

SparseMultiContextBlockImpl::SparseMultiContextBlockImpl(const SparseBlockOptions& options) {
  const bool cross = !options.context_channels.empty();
  norm1_ = nn::BlockNorm(*this, "norm1", options.channels, options.affine_norms);
  if (cross) norm2_ = nn::BlockNorm(*this, "norm2", options.channels, /*affine=*/true);
  norm3_ = nn::BlockNorm(*this, "norm3", options.channels, options.affine_norms);
  self_attention_ = register_module("self_attn", SparseAttention(block_self_attention(options)));
  for (const std::int64_t width : options.context_channels) {
    const std::string number = std::to_string(cross_attentions_.size());
    cross_attentions_.push_back(
        register_module("cross_attn_" + number, SparseAttention(block_cross_attention(options, width))));
    context_norms_.push_back(register_module("ctx_norm_" + number, nn::AffineLayerNorm(width, nn::kBlockNormEps)));
  }
  mlp_ = register_module("mlp", block_mlp(options));
}

SparseTensor SparseMultiContextBlockImpl::forward(const SparseTensor& x, const std::vector<SparseTensor>& contexts) {
  TORCH_CHECK(contexts.size() == cross_attentions_.size(), "a block for ", cross_attentions_.size(),
              " contexts was given ", contexts.size());
  Tensor h = x.feats + self_attention_->forward(x.with(norm1_(x.feats))).feats;
  if (!contexts.empty()) {
    const SparseTensor queries = x.with(norm2_(h));
    for (std::size_t i = 0; i < contexts.size(); ++i) {
      const SparseTensor context = contexts[i].with(context_norms_[i]->forward(contexts[i].feats));
      h = h + cross_attentions_[i]->forward(queries, context).feats;
    }
  }
  return x.with(h + mlp_->forward(norm3_(h)));
}

}  // namespace anigen::sparse
