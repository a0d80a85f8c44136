#pragma once
#include <string>
#include <vector>

#include "anigen/models/anymate/attention.h"
#include "anigen/nn/affine_layer_norm.h"

namespace anigen::models::anymate {

inline constexpr double kNormEps = 1e-5;  ///< of every layer norm (reference anymate-baselines.md, 2.1)

/// Linear · GELU in its exact (erf) form · Linear, under the names given.
class ErfMlpImpl : public torch::nn::Module {
 public:
  ErfMlpImpl(std::int64_t in, std::int64_t hidden, std::int64_t out, const std::string& first = "c_fc",
             const std::string& second = "c_proj");
  Tensor forward(const Tensor& x);  ///< @param x [..., in] @return [..., out]

 private:
  nn::Linear first_ = nullptr, second_ = nullptr;
};
TORCH_MODULE(ErfMlp);

/// Pre-norm self-attention block ("RAB", reference anymate-baselines.md, 2.1): x += attn(ln_1 x), x += mlp(ln_2 x),
/// with hidden width 4W. Keys `attn.{c_qkv,c_proj}`, `ln_1`, `ln_2`, `mlp.{c_fc,c_proj}`.
class ResidualAttentionImpl : public torch::nn::Module {
 public:
  ResidualAttentionImpl(std::int64_t width, std::int64_t heads, bool qkv_bias);
  /// Rows that the mask hides as keys are still computed. @param x [B, N, W] @return [B, N, W]
  Tensor forward(const Tensor& x, const KeyMask& mask = {});

 private:
  InterleavedSelfAttention attention_ = nullptr;
  nn::AffineLayerNorm ln_1_ = nullptr, ln_2_ = nullptr;
  ErfMlp mlp_ = nullptr;
};
TORCH_MODULE(ResidualAttention);

/// Pre-norm cross-attention block ("RCAB"): x += attn(ln_1 x, ln_2 data), x += mlp(ln_3 x). Keys
/// `attn.{c_q,c_kv,c_proj}`, `ln_1`, `ln_2`, `ln_3`, `mlp.{c_fc,c_proj}`.
class ResidualCrossAttentionImpl : public torch::nn::Module {
 public:
  /// @param data_width of what is attended to; 0: the width
  ResidualCrossAttentionImpl(std::int64_t width, std::int64_t heads, bool qkv_bias, std::int64_t data_width = 0);
  /// @param x [B, N, W] @param data [B, M, D] @param mask of the M keys @return [B, N, W]
  Tensor forward(const Tensor& x, const Tensor& data, const KeyMask& mask = {});

 private:
  InterleavedCrossAttention attention_ = nullptr;
  nn::AffineLayerNorm ln_1_ = nullptr, ln_2_ = nullptr, ln_3_ = nullptr;
  ErfMlp mlp_ = nullptr;
};
TORCH_MODULE(ResidualCrossAttention);

/// Residual attention blocks one after another. Keys `resblocks.<i>.*`.
class ResidualStackImpl : public torch::nn::Module {
 public:
  ResidualStackImpl(std::int64_t layers, std::int64_t width, std::int64_t heads, bool qkv_bias);
  Tensor forward(Tensor x, const KeyMask& mask = {});  ///< @param x [B, N, W] @return [B, N, W]

 private:
  std::vector<ResidualAttention> blocks_;
};
TORCH_MODULE(ResidualStack);

}  // namespace anigen::models::anymate
