#include "anigen/models/anymate/scratch_encoder.h"

#include <cmath>

#include "anigen/models/anymate/checks.h"
#include "anigen/models/anymate/init.h"

namespace anigen::models::anymate {
namespace {

constexpr double kScratchQueryDeviation = 0.02;

}  // namespace

ScratchEncoderImpl::ScratchEncoderImpl(const ScratchEncoderOptions& options, nn::Init init) {
  PerceiverOptions perceiver;
  perceiver.num_latents = options.num_latents;
  perceiver.width = options.width;
  perceiver.heads = options.heads;
  perceiver.layers = options.num_encoder_layers;
  perceiver.num_freqs = options.num_freqs;
  encoder_ = register_module("encoder", PerceiverEncoder(perceiver));
  if (init == nn::Init::kNone) return;
  default_layers(*this);
  normal_blocks(*this, options.init_scale / std::sqrt(static_cast<double>(options.width)));
  torch::nn::init::normal_(encoder_->query, 0.0, kScratchQueryDeviation);
}

Tensor ScratchEncoderImpl::forward(const Tensor& points) {
  require_shape(points, {-1, -1, 6}, "points_cloud");
  return encoder_(points.slice(-1, 0, 3), points.slice(-1, 3, 6));
}

}  // namespace anigen::models::anymate
