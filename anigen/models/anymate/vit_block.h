#pragma once
#include "anigen/models/anymate/blocks.h"

namespace anigen::models::anymate {

/// Self attention with keys `qkv.weight` (rows q, k, v, no bias; head j owns channels jd … of each) and `proj.*`.
class VitAttentionImpl : public torch::nn::Module {
 public:
  VitAttentionImpl(std::int64_t width, std::int64_t heads);
  Tensor forward(const Tensor& x);  ///< @param x [B, N, W] @return [B, N, W]

 private:
  std::int64_t heads_;
  nn::Linear qkv_ = nullptr, proj_ = nullptr;
};
TORCH_MODULE(VitAttention);

/// Pre-norm block of a vision transformer with stochastic depth (Huang et al. 2016): while training each branch of each
/// item is left out with a probability, and scaled up otherwise. Keys `norm1`, `attn.*`, `norm2`, `mlp.{fc1,fc2}`.
class VitBlockImpl : public torch::nn::Module {
 public:
  /// @param drop_path probability, in [0, 1)
  VitBlockImpl(std::int64_t width, std::int64_t heads, double drop_path);
  Tensor forward(const Tensor& x);  ///< @param x [B, N, W] @return [B, N, W]

 private:
  Tensor kept(const Tensor& branch) const;

  double drop_path_;
  nn::AffineLayerNorm norm1_ = nullptr, norm2_ = nullptr;
  VitAttention attention_ = nullptr;
  ErfMlp mlp_ = nullptr;
};
TORCH_MODULE(VitBlock);

}  // namespace anigen::models::anymate
