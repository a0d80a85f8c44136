#include "anigen/models/anymate/style_generator.h"

#include <algorithm>
#include <cmath>
#include <memory>
#include <string>

#include "anigen/models/anymate/checks.h"

namespace anigen::models::anymate {
namespace {

constexpr std::int64_t kFirstSide = 4;
constexpr double kMappingRate = 0.01, kMappingSlope = 0.2, kMomentEps = 1e-8;

}  // namespace

StyleBlockImpl::StyleBlockImpl(std::int64_t in, std::int64_t out, std::int64_t side,
                               const StyleGeneratorOptions& options) {
  if (in == 0) const_ = register_parameter("const", torch::empty({out, side, side}));
  resample_filter_ = register_buffer("resample_filter", resampling_filter());
  if (in > 0) conv0_ = register_module("conv0", StyledConv(in, out, options.w_dim, side, /*up=*/true));
  conv1_ = register_module("conv1", StyledConv(out, out, options.w_dim, side, /*up=*/false));
  torgb_ = register_module("torgb", ToImage(out, options.img_channels, options.w_dim));
}

void StyleBlockImpl::initialize() {
  if (const_.defined()) torch::nn::init::normal_(const_);
  if (!conv0_.is_empty()) conv0_->initialize();
  conv1_->initialize();
  torgb_->initialize();
}

void StyleBlockImpl::forward(Tensor& features, Tensor& image, const Tensor& w, StyleNoise noise) {
  features = const_.defined() ? const_.unsqueeze(0).expand({w.size(0), -1, -1, -1}) : conv0_(features, w, noise);
  features = conv1_(features, w, noise);
  const Tensor more = torgb_(features, w);
  image = image.defined() ? upsampled_image(image, resample_filter_) + more : more;
}

StyleGeneratorImpl::StyleGeneratorImpl(const StyleGeneratorOptions& options) {
  const std::int64_t last = options.img_resolution;
  require(last >= kFirstSide && (last & (last - 1)) == 0, "img_resolution",
          std::to_string(last) + " is no power of two from 4 on");
  require(options.mapping_layers > 0, "mapping_layers", "must be positive");
  const auto synthesis = register_module("synthesis", std::make_shared<torch::nn::Module>());
  std::int64_t channels = 0;
  for (std::int64_t side = kFirstSide; side <= last; side *= 2) {
    const std::int64_t out = std::min(options.channel_base / side, options.channel_max);
    require(out > 0, "channel_base", "leaves no channel at side " + std::to_string(side));
    blocks_.push_back(synthesis->register_module("b" + std::to_string(side), StyleBlock(channels, out, side, options)));
    channels = out;
  }
  const auto mapping = register_module("mapping", std::make_shared<torch::nn::Module>());
  w_avg_ = mapping->register_buffer("w_avg", torch::zeros({options.w_dim}));
  for (std::int64_t i = 0; i < options.mapping_layers; ++i) {
    const std::int64_t in = i == 0 ? options.z_dim : options.w_dim;
    mapping_.push_back(
        mapping->register_module("fc" + std::to_string(i), EqualizedLinear(in, options.w_dim, kMappingRate)));
  }
}

void StyleGeneratorImpl::initialize() {
  for (EqualizedLinear& layer : mapping_) layer->initialize();
  for (StyleBlock& block : blocks_) block->initialize();
}

Tensor StyleGeneratorImpl::style(const Tensor& z) {
  require_shape(z, {-1, mapping_.front()->weight.size(1)}, "z");
  Tensor w = z * (z.square().mean(1, /*keepdim=*/true) + kMomentEps).rsqrt();
  for (EqualizedLinear& layer : mapping_) w = torch::leaky_relu(layer(w), kMappingSlope) * std::sqrt(2.0);
  return w;
}

Tensor StyleGeneratorImpl::image(const Tensor& w, StyleNoise noise) {
  Tensor features, image;
  for (StyleBlock& block : blocks_) block->forward(features, image, w, noise);
  return image;
}

}  // namespace anigen::models::anymate
