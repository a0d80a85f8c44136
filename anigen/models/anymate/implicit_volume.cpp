#include "anigen/models/anymate/implicit_volume.h"

#include "anigen/models/anymate/checks.h"
#include "anigen/models/anymate/embedders.h"
#include "anigen/models/anymate/init.h"

namespace anigen::models::anymate {

ImplicitVolumeImpl::ImplicitVolumeImpl(const HeadOptions& options, nn::Init init) : options_(options) {
  const std::int64_t width = options.width;
  query_proj_ = register_module("query_proj", nn::Linear(fourier_width(options.num_freqs), width));
  cross_attn_decoder_ =
      register_module("cross_attn_decoder", ResidualCrossAttention(width, options.heads, options.qkv_bias));
  ln_post_ = register_module("ln_post", nn::AffineLayerNorm(width, kNormEps));
  output_proj_ = register_module("output_proj", nn::Linear(width, 1));
  if (init == nn::Init::kNone) return;
  default_layers(*this);
  normal_blocks(*this, options.init_scale);
}

Tensor ImplicitVolumeImpl::forward(const Tensor& latents, const Tensor& queries) {
  require_shape(latents, {-1, -1, options_.width}, "latents");
  require_shape(queries, {latents.size(0), -1, 3}, "queries");
  const Tensor x = query_proj_(fourier_features(queries, options_.num_freqs, /*include_pi=*/true));
  return output_proj_(ln_post_(cross_attn_decoder_(x, latents)));
}

}  // namespace anigen::models::anymate
