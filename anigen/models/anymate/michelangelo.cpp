#include "anigen/models/anymate/michelangelo.h"

#include <cmath>
#include <vector>

#include "anigen/models/anymate/checks.h"
#include "anigen/models/anymate/embedders.h"
#include "anigen/models/anymate/init.h"

namespace anigen::models::anymate {
namespace {

constexpr double kLeastLogvar = -30.0, kMostLogvar = 20.0;
constexpr double kQueryDeviation = 0.02;

PerceiverOptions perceiver_options(const MichelangeloOptions& options) {
  PerceiverOptions perceiver;
  perceiver.num_latents = options.num_latents + 1;
  perceiver.features = options.point_feats + kHarmonics;
  perceiver.width = options.width;
  perceiver.heads = options.heads;
  perceiver.layers = options.num_encoder_layers;
  perceiver.num_freqs = options.num_freqs;
  perceiver.include_pi = options.include_pi;
  perceiver.qkv_bias = options.qkv_bias;
  perceiver.ln_post = options.use_ln_post;
  return perceiver;
}

}  // namespace

MichelangeloEncoderImpl::MichelangeloEncoderImpl(const MichelangeloOptions& options, nn::Init init)
    : options_(options) {
  require(options.point_feats == 3, "point_feats", "must be 3, the normal");
  const std::int64_t width = options.width;
  shape_projection_ = register_parameter("shape_projection", torch::empty({width, width}));
  encoder_ = register_module("encoder", PerceiverEncoder(perceiver_options(options)));
  if (!options.only_embed) {
    pre_kl_ = register_module("pre_kl", nn::Linear(width, 2 * options.embed_dim));
    post_kl_ = register_module("post_kl", nn::Linear(options.embed_dim, width));
    transformer_ = register_module("transformer",
                                   ResidualStack(options.num_decoder_layers, width, options.heads, options.qkv_bias));
  }
  if (init == nn::Init::kNone) return;
  default_layers(*this);
  normal_blocks(*this, options.init_scale / std::sqrt(static_cast<double>(width)));
  torch::nn::init::normal_(encoder_->query, 0.0, kQueryDeviation);
  torch::nn::init::normal_(shape_projection_, 0.0, 1.0 / std::sqrt(static_cast<double>(width)));
}

Tensor MichelangeloEncoderImpl::perceived(const Tensor& points) {
  require_shape(points, {-1, -1, 6}, "points_cloud");
  const Tensor positions = points.slice(-1, 0, 3), normals = points.slice(-1, 3, 6);
  return encoder_(positions, torch::cat({normals, spherical_harmonics(normals)}, -1));
}

Tensor MichelangeloEncoderImpl::shape_embed(const Tensor& points) {
  return torch::matmul(perceived(points).select(1, 0), shape_projection_);
}

MichelangeloCode MichelangeloEncoderImpl::encode(const Tensor& points, const Tensor& noise) {
  require(!options_.only_embed, "only_embed", "an encoder of one embedding has no latents");
  const Tensor tokens = perceived(points);
  MichelangeloCode code;
  code.shape_embed = torch::matmul(tokens.select(1, 0), shape_projection_);
  code.shape_latents = tokens.slice(1, 1);
  const std::vector<Tensor> moments = pre_kl_(code.shape_latents).chunk(2, -1);
  code.kl_mean = moments[0];
  code.kl_logvar = moments[1].clamp(kLeastLogvar, kMostLogvar);
  Tensor sample = code.kl_mean;
  if (noise.defined() || is_training()) {
    if (noise.defined()) require_shape(noise, sample.sizes().vec(), "noise");
    sample = sample + (0.5 * code.kl_logvar).exp() * (noise.defined() ? noise : torch::randn_like(sample));
  }
  code.latents = transformer_(post_kl_(sample));
  return code;
}

Tensor MichelangeloEncoderImpl::forward(const Tensor& points, const Tensor& noise) {
  return options_.only_embed ? shape_embed(points) : encode(points, noise).tokens();
}

}  // namespace anigen::models::anymate
