#include "anigen/anymate/style.h"

#include <algorithm>
#include <cmath>
#include <memory>
#include <string>

#include "anigen/anymate/blocks.h"

namespace anigen::anymate {

namespace {

constexpr double kSlope = 0.2, kVarianceEps = 1e-8;
constexpr double kUpsamplingGain = 4.0;  // what inserting three zeros beside every pixel takes away

// One filter for each channel alone, [C, 1, h, w].
Tensor for_each_channel(const Tensor& filter, std::int64_t channels) {
  return filter.expand({channels, 1, filter.size(0), filter.size(1)});
}

Tensor as_channels(const Tensor& values) { return values.unsqueeze(-1).unsqueeze(-1); }

constexpr std::int64_t kFirstSide = 4;
constexpr double kMappingRate = 0.01, kMappingSlope = 0.2, kMomentEps = 1e-8;

// The outer product of [1, 3, 3, 1] with itself over 64, [4, 4].
Tensor resampling_filter() {
  const Tensor line = torch::tensor({1.0F, 3.0F, 3.0F, 1.0F}) / 8.0;
  return torch::outer(line, line);
}

// Twice the height and width: zeros between pixels, then the filter with gain 4.
Tensor upsampled_image(const Tensor& x, const Tensor& filter) {
  // Zeros between pixels, two zeros before, one behind, and the filter: a transposed convolution without its rim.
  const Tensor each = for_each_channel(filter * kUpsamplingGain, x.size(1));
  return at::conv_transpose2d(x, each, /*bias=*/{}, /*stride=*/2, /*padding=*/1, /*output_padding=*/0,
                              /*groups=*/x.size(1));
}

}  // namespace

EqualizedLinearImpl::EqualizedLinearImpl(std::int64_t in, std::int64_t out, double rate_multiplier)
    : rate_multiplier_(rate_multiplier) {
  weight = register_parameter("weight", torch::empty({out, in}));
  bias = register_parameter("bias", torch::empty({out}));
}

Tensor EqualizedLinearImpl::forward(const Tensor& x) {
  const double gain = rate_multiplier_ / std::sqrt(static_cast<double>(weight.size(1)));
  return torch::linear(x, weight * gain, bias * rate_multiplier_);
}

void EqualizedLinearImpl::initialize(double first_bias) {
  torch::nn::init::normal_(weight, 0.0, 1.0 / rate_multiplier_);
  torch::nn::init::constant_(bias, first_bias);
}

StyledConvImpl::StyledConvImpl(std::int64_t in, std::int64_t out, std::int64_t style, std::int64_t side, bool up)
    : up_(up) {
  weight_ = register_parameter("weight", torch::empty({out, in, 3, 3}));
  noise_strength_ = register_parameter("noise_strength", torch::empty({}));
  bias_ = register_parameter("bias", torch::empty({out}));
  resample_filter_ = register_buffer("resample_filter", resampling_filter());
  noise_const_ = register_buffer("noise_const", torch::empty({side, side}));
  affine_ = register_module("affine", EqualizedLinear(style, in));
}

void StyledConvImpl::initialize() {
  torch::nn::init::normal_(weight_);
  torch::nn::init::zeros_(noise_strength_);
  torch::nn::init::zeros_(bias_);
  torch::nn::init::normal_(noise_const_);
  affine_->initialize(/*first_bias=*/1.0);
}

Tensor StyledConvImpl::forward(const Tensor& x, const Tensor& w, StyleNoise noise) {
  const Tensor style = affine_(w);
  // Scaling weights by a style per item and normalising them is scaling what goes in and what comes out.
  const Tensor energy = torch::matmul(style.square(), weight_.square().sum({2, 3}).t());  // [B, out]
  Tensor y = x * as_channels(style);
  if (up_) {
    y = at::conv_transpose2d(y, weight_.transpose(0, 1), /*bias=*/{}, /*stride=*/2);
    const Tensor filter = for_each_channel(resample_filter_.flip({0, 1}) * kUpsamplingGain, y.size(1));
    y = at::conv2d(y, filter, /*bias=*/{}, /*stride=*/1, /*padding=*/1, /*dilation=*/1, /*groups=*/y.size(1));
  } else {
    y = at::conv2d(y, weight_, /*bias=*/{}, /*stride=*/1, /*padding=*/1);
  }
  y = y * as_channels((energy + kVarianceEps).rsqrt());
  if (noise == StyleNoise::kConst) y = y + noise_const_ * noise_strength_;
  if (noise == StyleNoise::kRandom) {
    y = y + torch::randn({y.size(0), 1, y.size(2), y.size(3)}, y.options()) * noise_strength_;
  }
  return torch::leaky_relu(y + as_channels(bias_), kSlope) * std::sqrt(2.0);
}

ToImageImpl::ToImageImpl(std::int64_t in, std::int64_t out, std::int64_t style) {
  weight_ = register_parameter("weight", torch::empty({out, in, 1, 1}));
  bias_ = register_parameter("bias", torch::empty({out}));
  affine_ = register_module("affine", EqualizedLinear(style, in));
}

void ToImageImpl::initialize() {
  torch::nn::init::normal_(weight_);
  torch::nn::init::zeros_(bias_);
  affine_->initialize(/*first_bias=*/1.0);
}

Tensor ToImageImpl::forward(const Tensor& x, const Tensor& w) {
  const Tensor style = affine_(w) / std::sqrt(static_cast<double>(x.size(1)));
  return at::conv2d(x * as_channels(style), weight_, bias_);
}

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

}  // namespace anigen::anymate
