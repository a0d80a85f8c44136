#include "anigen/models/dinov2_block.h"

#include <vector>

#include "anigen/nn/attention.h"
#include "anigen/nn/layer_norm.h"

namespace anigen::models {

Dinov2AttentionImpl::Dinov2AttentionImpl(std::int64_t channels, std::int64_t num_heads) : num_heads_(num_heads) {
  qkv_ = register_module("qkv", nn::Linear(channels, 3 * channels));
  proj_ = register_module("proj", nn::Linear(channels, channels));
}

Tensor Dinov2AttentionImpl::forward(const Tensor& x) {
  const std::int64_t channels = x.size(2);
  const Tensor heads = qkv_->forward(x).view({x.size(0), x.size(1), 3, num_heads_, channels / num_heads_});
  const std::vector<Tensor> parts = heads.permute({2, 0, 3, 1, 4}).unbind(0);  // [B, h, T, d] each
  const Tensor mixed = nn::attend(parts[0], parts[1], parts[2]);
  return proj_->forward(mixed.transpose(1, 2).reshape({x.size(0), x.size(1), channels}));
}

Dinov2FeedForwardImpl::Dinov2FeedForwardImpl(const Dinov2Options& options) : swiglu_(options.swiglu()) {
  const std::int64_t channels = options.embed_dim, hidden = options.ffn_hidden();
  first_ = register_module(swiglu_ ? "w12" : "fc1", nn::Linear(channels, swiglu_ ? 2 * hidden : hidden));
  second_ = register_module(swiglu_ ? "w3" : "fc2", nn::Linear(hidden, channels));
}

Tensor Dinov2FeedForwardImpl::forward(const Tensor& x) {
  const Tensor inner = first_->forward(x);
  if (!swiglu_) return second_->forward(torch::gelu(inner));
  const std::vector<Tensor> halves = inner.chunk(2, -1);
  return second_->forward(torch::silu(halves[0]) * halves[1]);
}

Dinov2BlockImpl::Dinov2BlockImpl(const Dinov2Options& options) {
  const std::int64_t channels = options.embed_dim;
  norm1_ = register_module("norm1", nn::AffineLayerNorm(channels, nn::kBlockNormEps));
  attention_ = register_module("attn", Dinov2Attention(channels, options.num_heads));
  ls1_ = register_module("ls1", nn::LayerScale(channels));
  norm2_ = register_module("norm2", nn::AffineLayerNorm(channels, nn::kBlockNormEps));
  mlp_ = register_module("mlp", Dinov2FeedForward(options));
  ls2_ = register_module("ls2", nn::LayerScale(channels));
}

Tensor Dinov2BlockImpl::forward(const Tensor& x) {
  const Tensor attended = x + ls1_->forward(attention_->forward(norm1_->forward(x)));
  return attended + ls2_->forward(mlp_->forward(norm2_->forward(attended)));
}

}  // namespace anigen::models
