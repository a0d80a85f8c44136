#include "anigen/models/anymate/perceiver.h"

#include "anigen/models/anymate/checks.h"
#include "anigen/models/anymate/embedders.h"

namespace anigen::models::anymate {

PerceiverEncoderImpl::PerceiverEncoderImpl(const PerceiverOptions& options) : options_(options) {
  require(options.num_latents > 0, "num_latents", "must be positive");
  const std::int64_t channels = fourier_width(options.num_freqs) + options.features;
  query = register_parameter("query", torch::empty({options.num_latents, options.width}));
  input_proj_ = register_module("input_proj", nn::Linear(channels, options.width));
  cross_attn_ = register_module("cross_attn", ResidualCrossAttention(options.width, options.heads, options.qkv_bias));
  self_attn_ =
      register_module("self_attn", ResidualStack(options.layers, options.width, options.heads, options.qkv_bias));
  if (options.ln_post) ln_post_ = register_module("ln_post", nn::AffineLayerNorm(options.width, kNormEps));
}

Tensor PerceiverEncoderImpl::forward(const Tensor& positions, const Tensor& features) {
  const Tensor waves = fourier_features(positions, options_.num_freqs, options_.include_pi);
  const Tensor points = input_proj_(torch::cat({waves, features}, -1));
  const Tensor queries = query.unsqueeze(0).expand({positions.size(0), -1, -1});
  const Tensor tokens = self_attn_(cross_attn_(queries, points));
  return ln_post_.is_empty() ? tokens : ln_post_(tokens);
}

}  // namespace anigen::models::anymate
