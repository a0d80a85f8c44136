#pragma once
#include "anigen/models/anymate/perceiver.h"
#include "anigen/nn/init.h"

namespace anigen::models::anymate {

struct ScratchEncoderOptions {
  std::int64_t num_latents = 16, width = 768, heads = 12, num_encoder_layers = 8, num_freqs = 8;
  double init_scale = 0.25;
};

/// The point encoder that the released diffusion config trains from random weights (reference anymate-baselines.md,
/// 2.4): a perceiver over positions and normals, all maps with biases. Keys `encoder.*` (PerceiverEncoder).
class ScratchEncoderImpl : public torch::nn::Module {
 public:
  explicit ScratchEncoderImpl(const ScratchEncoderOptions& options = {}, nn::Init init = nn::Init::kPublished);
  /// @param points [B, N, 6], positions in [-1, 1] and unit normals @return [B, M, W]
  Tensor forward(const Tensor& points);

 private:
  PerceiverEncoder encoder_ = nullptr;
};
TORCH_MODULE(ScratchEncoder);

}  // namespace anigen::models::anymate
