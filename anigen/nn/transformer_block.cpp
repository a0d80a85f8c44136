#include "anigen/nn/transformer_block.h"

#include "anigen/nn/layer_norm.h"

namespace anigen::nn {
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

}  // namespace anigen::nn
