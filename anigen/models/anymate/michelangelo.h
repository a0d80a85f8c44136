#pragma once
#include "anigen/models/anymate/perceiver.h"
#include "anigen/nn/init.h"

namespace anigen::models::anymate {

/// Arguments of the released shape encoder ("shapevae-256") under their own names.
struct MichelangeloOptions {
  std::int64_t num_latents = 256;  ///< without the class token
  std::int64_t embed_dim = 64;     ///< of the bottleneck
  std::int64_t point_feats = 3;    ///< normals; their harmonics are added to them
  std::int64_t num_freqs = 8;
  bool include_pi = false;  ///< unlike all other modules
  std::int64_t width = 768, heads = 12, num_encoder_layers = 8, num_decoder_layers = 16;
  bool use_ln_post = true, qkv_bias = false;
  double init_scale = 0.25;
  bool only_embed = false;  ///< what the tri-plane decoder needs: no bottleneck and no decoder
};

/// What the encoder computes on its way.
struct MichelangeloCode {
  Tensor shape_embed;         ///< [B, W], the class token in the space of pictures and text
  Tensor shape_latents;       ///< [B, M, W], before the bottleneck
  Tensor kl_mean, kl_logvar;  ///< [B, M, E]; the latter within [-30, 20]
  Tensor latents;             ///< [B, M, W], decoded from the sample
  Tensor tokens() const { return torch::cat({shape_embed.unsqueeze(1), latents}, 1); }  ///< [B, 1 + M, W]
};

/// The shape encoder of Michelangelo (Zhao et al. 2023) as Anymate widened it: 25 harmonics of the normal as further
/// input (reference anymate-baselines.md, 2.3). Keys `shape_projection`, `encoder.*` (PerceiverEncoder), `pre_kl.*`,
/// `post_kl.*`, `transformer.resblocks.<i>.*`; with only_embed the first two alone.
class MichelangeloEncoderImpl : public torch::nn::Module {
 public:
  explicit MichelangeloEncoderImpl(const MichelangeloOptions& options = {}, nn::Init init = nn::Init::kPublished);

  /// @param points [B, N, 6], positions in [-1, 1] and unit normals
  /// @param noise [B, M, E] standard normal draws for the sample of the bottleneck. Undefined: drawn from torch's
  ///   default generator while training, none (the mean) in evaluation, where the released code draws too
  /// @return [B, 1 + M, W]; with only_embed [B, W] @throws InputError for other shapes
  Tensor forward(const Tensor& points, const Tensor& noise = {});
  /// The same step by step. @throws InputError with only_embed
  MichelangeloCode encode(const Tensor& points, const Tensor& noise = {});
  Tensor shape_embed(const Tensor& points);  ///< [B, W]

 private:
  Tensor perceived(const Tensor& points);

  MichelangeloOptions options_;
  Tensor shape_projection_;
  PerceiverEncoder encoder_ = nullptr;
  nn::Linear pre_kl_ = nullptr, post_kl_ = nullptr;
  ResidualStack transformer_ = nullptr;
};
TORCH_MODULE(MichelangeloEncoder);

}  // namespace anigen::models::anymate
