#pragma once
#include "anigen/models/anymate/blocks.h"

namespace anigen::models::anymate {

struct PerceiverOptions {
  std::int64_t num_latents = 16;  ///< learned queries, and so tokens that come out
  std::int64_t features = 3;      ///< channels of a point beside the Fourier features of its position
  std::int64_t width = 768, heads = 12, layers = 8;
  std::int64_t num_freqs = 8;
  bool include_pi = true, qkv_bias = true;
  bool ln_post = false;  ///< a layer norm at the end
};

/// Points to a few tokens (Jaegle et al. 2021, "Perceiver"; reference anymate-baselines.md, 2.3 and 2.4): learned
/// queries attend to all points once, then to each other. Keys `query` [M, W], `input_proj.*`, `cross_attn.*`,
/// `self_attn.resblocks.<i>.*` and, if asked for, `ln_post.*`. Parameters are not initialised here.
class PerceiverEncoderImpl : public torch::nn::Module {
 public:
  explicit PerceiverEncoderImpl(const PerceiverOptions& options);
  /// @param positions [B, N, 3] @param features [B, N, features] @return [B, M, W]
  Tensor forward(const Tensor& positions, const Tensor& features);

  Tensor query;

 private:
  PerceiverOptions options_;
  nn::Linear input_proj_ = nullptr;
  ResidualCrossAttention cross_attn_ = nullptr;
  ResidualStack self_attn_ = nullptr;
  nn::AffineLayerNorm ln_post_ = nullptr;
};
TORCH_MODULE(PerceiverEncoder);

}  // namespace anigen::models::anymate
