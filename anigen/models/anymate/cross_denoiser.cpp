#include "anigen/models/anymate/cross_denoiser.h"

#include "anigen/models/anymate/checks.h"
#include "anigen/models/anymate/init.h"
#include "anigen/nn/kept_contexts.h"
#include "anigen/nn/module_list.h"

namespace anigen::models::anymate {
namespace {

constexpr double kLatentDeviation = 0.02;

}  // namespace

LatentCompressionImpl::LatentCompressionImpl(std::int64_t num_latents, std::int64_t width, std::int64_t heads) {
  query = register_parameter("query", torch::empty({num_latents, width}));
  cross_attn_ = register_module("cross_attn", ResidualCrossAttention(width, heads, /*qkv_bias=*/true));
  output_proj_ = register_module("output_proj", nn::Linear(width, width));
}

Tensor LatentCompressionImpl::forward(const Tensor& latents) {
  return output_proj_(cross_attn_(query.unsqueeze(0).expand({latents.size(0), -1, -1}), latents));
}

CrossDenoiserImpl::CrossDenoiserImpl(const CrossDenoiserOptions& options, nn::Init init) : options_(options) {
  require(options.num_z > 0 && options.num_latents > 0, "num_z", "there must be latents");
  const std::int64_t z_dim = options.z_dim, x_dim = options.x_dim;
  const std::int64_t tokens = options.num_z + options.num_latents + 1;  // and the level
  const auto hidden = static_cast<std::int64_t>(static_cast<double>(z_dim) * options.mlp_ratio);
  prev_latent_ = register_parameter("prev_latent", torch::empty({1, tokens, z_dim}));
  z_init_ = register_parameter("z_init", torch::empty({1, options.num_z, z_dim}));
  if (options.use_projection) {
    proj_transformer_ =
        register_module("proj_transformer", LatentCompression(options.num_latents, z_dim, options.num_heads));
  }
  input_proj_ = register_module("input_proj", nn::Linear(3, x_dim));
  ln_pre_ = register_module("ln_pre", nn::AffineLayerNorm(x_dim, kNormEps));
  time_embed_ = register_module("time_embed", ErfMlp(z_dim, hidden, z_dim, "fc1", "fc2"));
  latent_mlp_ = register_module("latent_mlp", ErfMlp(z_dim, hidden, z_dim, "fc1", "fc2"));
  ln_latent_ = register_module("ln_latent", nn::AffineLayerNorm(z_dim, kNormEps));
  const ReadWriteOptions streams = {z_dim, x_dim, options.num_heads, options.mlp_ratio, options.qkv_bias};
  for (std::int64_t i = 0; i < options.num_blocks; ++i) blocks_.emplace_back(streams, options.num_compute_layers);
  register_module("blocks", nn::module_list(blocks_));
  ln_post_ = register_module("ln_post", nn::AffineLayerNorm(x_dim, kNormEps));
  output_proj_ = register_module("output_proj", nn::Linear(x_dim, 3));
  if (init == nn::Init::kPublished) initialize();
}

void CrossDenoiserImpl::initialize() {
  nn::default_norms(*this);
  nn::xavier_uniform_linears(*this);
  nn::zero_parameters(*ln_latent_);
  torch::nn::init::zeros_(prev_latent_);
  torch::nn::init::normal_(z_init_, 0.0, kLatentDeviation);
  if (!proj_transformer_.is_empty()) torch::nn::init::normal_(proj_transformer_->query, 0.0, kLatentDeviation);
}

Tensor CrossDenoiserImpl::latent_stream(const Tensor& t, const Tensor& latents) {
  const std::int64_t items = latents.size(0);
  const Tensor condition = proj_transformer_.is_empty()
                               ? latents
                               : nn::context_of(this, latents, [&] { return proj_transformer_(latents); });
  const Tensor level = time_embed_(level_features(t, items, options_.z_dim).to(latents.options())).unsqueeze(1);
  const Tensor z = torch::cat({z_init_.expand({items, -1, -1}), condition, level}, 1);
  // Where PointInfinity hands over the latents of the step before, a learned constant.
  return z + ln_latent_(prev_latent_ + latent_mlp_(prev_latent_.detach()));
}

Tensor CrossDenoiserImpl::forward(const Tensor& x, const Tensor& t, const Tensor& latents) {
  require_shape(x, {-1, 3, -1}, "x");
  require_shape(latents, {x.size(0), options_.use_projection ? -1 : options_.num_latents, options_.z_dim}, "latents");
  Tensor points = ln_pre_(input_proj_(x.transpose(1, 2)));
  Tensor z = latent_stream(t, latents);
  for (ReadComputeWrite& block : blocks_) block->forward(z, points);
  return output_proj_(ln_post_(points)).transpose(1, 2);
}

}  // namespace anigen::models::anymate
