#include "anigen/models/anymate/concat_denoiser.h"

#include <cmath>

#include "anigen/models/anymate/checks.h"
#include "anigen/models/anymate/init.h"

namespace anigen::models::anymate {

ConcatDenoiserImpl::ConcatDenoiserImpl(const ConcatDenoiserOptions& options, nn::Init init) : options_(options) {
  require(options.cond_drop_prob >= 0.0 && options.cond_drop_prob <= 1.0, "cond_drop_prob", "must be in [0, 1]");
  const std::int64_t width = options.width;
  time_embed_ = register_module("time_embed", ErfMlp(width, 4 * width, width));
  ln_pre_ = register_module("ln_pre", nn::AffineLayerNorm(width, kNormEps));
  backbone_ = register_module("backbone", ResidualStack(options.layers, width, options.heads, /*qkv_bias=*/true));
  ln_post_ = register_module("ln_post", nn::AffineLayerNorm(width, kNormEps));
  input_proj_ = register_module("input_proj", nn::Linear(3, width));
  output_proj_ = register_module("output_proj", nn::Linear(width, 3));
  if (init == nn::Init::kNone) return;
  default_layers(*this);
  const double deviation = options.init_scale / std::sqrt(static_cast<double>(width));
  normal_blocks(*this, deviation);
  time_embed_->apply([deviation](torch::nn::Module& part) {
    if (auto* linear = part.as<nn::LinearImpl>()) nn::normal_linear(*linear, deviation);
  });
  nn::zero_parameters(*output_proj_);
}

Tensor ConcatDenoiserImpl::forward(const Tensor& x, const Tensor& t, const Tensor& latents) {
  require_shape(x, {-1, 3, -1}, "x");
  require_shape(latents, {x.size(0), -1, options_.width}, "latents");
  Tensor condition = latents;
  if (is_training() && options_.cond_drop_prob > 0.0) {
    const Tensor kept = torch::rand({x.size(0), 1, 1}, latents.options()) >= options_.cond_drop_prob;
    condition = condition * kept.to(latents.dtype());
  }
  const Tensor level = time_embed_(level_features(t, x.size(0), options_.width).to(latents.options())).unsqueeze(1);
  const Tensor sequence = torch::cat({condition, level, input_proj_(x.transpose(1, 2))}, 1);
  const Tensor out = ln_post_(backbone_(ln_pre_(sequence)));
  return output_proj_(out.slice(1, latents.size(1) + 1)).transpose(1, 2);
}

}  // namespace anigen::models::anymate
