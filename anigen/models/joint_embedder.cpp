#include "anigen/models/joint_embedder.h"

namespace anigen::models {

using torch::Tensor;

JointEmbedderImpl::JointEmbedderImpl(std::int64_t in_channels, std::int64_t hidden_dim, std::int64_t out_channels,
                                     const JointEmbedderOptions& options) {
  in_layer_ = register_module("in_layer", nn::FeedForward(in_channels, hidden_dim, options.mlp_ratio));
  torch::nn::ModuleList blocks;
  for (std::int64_t i = 0; i < options.depth; ++i) {
    if (options.jp_embed_attn) {
      attention_blocks_.emplace_back(hidden_dim, kJointEmbedderHeads, options.mlp_ratio);
      blocks->push_back(attention_blocks_.back());
    } else {
      plain_blocks_.emplace_back(hidden_dim, hidden_dim, options.mlp_ratio);
      blocks->push_back(plain_blocks_.back());
    }
  }
  register_module("blocks", blocks);
  out_layer_ = register_module("out_layer", nn::Linear(hidden_dim, out_channels));
}

Tensor JointEmbedderImpl::forward(const Tensor& pairs, const nn::Ragged& items) {
  const Tensor first = in_layer_->forward(pairs);
  return out_layer_->forward(run_blocks(first, items).to(nn::dtype_of(first)));
}

Tensor JointEmbedderImpl::run_blocks(const Tensor& first, const nn::Ragged& items) {
  if (!attention_blocks_.empty()) {
    Tensor h = first.to(attention_blocks_.front()->dtype());
    for (nn::TransformerBlock& block : attention_blocks_) h = block->forward(h, items);
    return h;
  }
  if (plain_blocks_.empty()) return first;
  // Each block adds the embedder's own input layer again, not the running value.
  const Tensor skip = first.to(plain_blocks_.front()->dtype());
  Tensor h = skip;
  for (nn::FeedForward& block : plain_blocks_) h = block->forward(h) + skip;
  return h;
}

}  // namespace anigen::models
