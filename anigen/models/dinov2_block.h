#pragma once
#include "anigen/models/dinov2_options.h"
#include "anigen/nn/affine_layer_norm.h"
#include "anigen/nn/layer_scale.h"
#include "anigen/nn/linear.h"

namespace anigen::models {

using torch::Tensor;

/// Multi-head self attention with keys `qkv` (rows q, k, v; head j owns channels j·C/h … of each) and `proj`.
class Dinov2AttentionImpl : public torch::nn::Module {
 public:
  Dinov2AttentionImpl(std::int64_t channels, std::int64_t num_heads);
  /// @param x [B, T, C] @return [B, T, C]
  Tensor forward(const Tensor& x);

 private:
  std::int64_t num_heads_;
  nn::Linear qkv_ = nullptr, proj_ = nullptr;
};
TORCH_MODULE(Dinov2Attention);

/// The feed-forward part: keys `fc1`, `fc2` with the exact (erf) GELU, or for SwiGLU `w12` (gate rows first) and `w3`.
class Dinov2FeedForwardImpl : public torch::nn::Module {
 public:
  explicit Dinov2FeedForwardImpl(const Dinov2Options& options);
  /// @param x [..., C] @return [..., C]
  Tensor forward(const Tensor& x);

 private:
  bool swiglu_;
  nn::Linear first_ = nullptr, second_ = nullptr;
};
TORCH_MODULE(Dinov2FeedForward);

/// Pre-norm block x += ls1 ⊙ attn(norm1(x)), x += ls2 ⊙ mlp(norm2(x)); norms with parameters and eps 1e-6 (reference
/// flows-and-pipeline.md, 5.3).
class Dinov2BlockImpl : public torch::nn::Module {
 public:
  explicit Dinov2BlockImpl(const Dinov2Options& options);
  /// @param x [B, T, C] @return [B, T, C]
  Tensor forward(const Tensor& x);

 private:
  nn::AffineLayerNorm norm1_ = nullptr, norm2_ = nullptr;
  Dinov2Attention attention_ = nullptr;
  Dinov2FeedForward mlp_ = nullptr;
  nn::LayerScale ls1_ = nullptr, ls2_ = nullptr;
};
TORCH_MODULE(Dinov2Block);

}  // namespace anigen::models
