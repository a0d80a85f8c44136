#pragma once
#include <string>

#include "anigen/nn/attention.h"
#include "anigen/nn/feed_forward.h"

namespace anigen::nn {

/// Pre-norm block x += MHSA(LN(x)), x += FFN(LN(x)); norms in fp32, eps 1e-6, without parameters (reference
/// autoencoders.md, 0.2, Block). Keys `attn.*` (or the given name) and `mlp.mlp.{0,2}.*`.
class TransformerBlockImpl : public torch::nn::Module {
 public:
  TransformerBlockImpl(std::int64_t channels, std::int64_t num_heads, double mlp_ratio = 4.0,
                       const std::string& attention_name = "attn");
  /// @param x [ΣN, C] @return [ΣN, C]
  Tensor forward(const Tensor& x, const Ragged& items);
  torch::Dtype dtype() const { return attention_->dtype(); }

 private:
  SelfAttention attention_ = nullptr;
  FeedForward mlp_ = nullptr;
};
TORCH_MODULE(TransformerBlock);

/// Pre-norm block without self attention: x += CrossAttn(LN(x), context), x += FFN(LN(x)); the context is not
/// normalised (reference autoencoders.md, 1.2). Keys `cross_attn.*` and `mlp.mlp.{0,2}.*`.
class CrossBlockImpl : public torch::nn::Module {
 public:
  CrossBlockImpl(std::int64_t channels, std::int64_t num_heads, double mlp_ratio = 4.0);
  /// @param x [ΣN, C] @param context [ΣM, C] @return [ΣN, C]
  Tensor forward(const Tensor& x, const Ragged& items, const Tensor& context, const Ragged& context_items);

 private:
  CrossAttention attention_ = nullptr;
  FeedForward mlp_ = nullptr;
};
TORCH_MODULE(CrossBlock);

}  // namespace anigen::nn
