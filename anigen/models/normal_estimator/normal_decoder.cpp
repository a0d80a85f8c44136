#include "anigen/models/normal_estimator/normal_decoder.h"

#include <cmath>

#include "anigen/models/normal_estimator/camera_rays.h"

namespace anigen::models {
namespace {

constexpr std::int64_t kRayChannels = 2, kHeadWidth = 128, kStateWidth = 64;

torch::nn::GroupNorm group_norm_of_8(std::int64_t channels) {
  return torch::nn::GroupNorm(torch::nn::GroupNormOptions(8, channels).eps(1e-5));
}

Tensor with_rays(const Tensor& map, const Tensor& slopes) {
  return torch::cat({map, slopes.expand({map.size(0), -1, -1, -1})}, 1);
}

Tensor leaky(Tensor x) { return torch::leaky_relu_(x, 0.01); }

}  // namespace

Tensor StandardizedConv2dImpl::forward(const Tensor& x) {
  const Tensor rows = weight.flatten(1);
  Tensor standardized = rows - rows.mean(1, /*keepdim=*/true);
  // The library's own deviation is several times slower than a norm.
  const double root = std::sqrt(static_cast<double>(rows.size(1) - 1));
  standardized.div_(standardized.norm(2, {1}, /*keepdim=*/true) / root + 1e-5);
  return same_convolution(x, standardized.view_as(weight), bias);
}

UpStageImpl::UpStageImpl(std::int64_t in, std::int64_t out) {
  const auto net = register_module("_net", std::make_shared<torch::nn::Module>());
  first_ = net->register_module("0", StandardizedConv2d(in, out, 3));
  first_norm_ = net->register_module("1", group_norm_of_8(out));
  second_ = net->register_module("3", StandardizedConv2d(out, out, 3));
  second_norm_ = net->register_module("4", group_norm_of_8(out));
}

Tensor UpStageImpl::forward(const Tensor& x, const Tensor& skip) {
  // One tensor after another, so that none of these wide ones outlives its use.
  Tensor y = at::upsample_bilinear2d(x, {skip.size(2), skip.size(3)}, /*align_corners=*/false);
  y = torch::cat({y, skip}, 1);
  y = first_(y);
  y = leaky(first_norm_(y));
  y = second_(y);
  return leaky(second_norm_(y));
}

NormalDecoderImpl::NormalDecoderImpl() {
  constexpr std::int64_t kBottom = 2048, kMiddle = 1024, kTop = 512, kSkip16 = 176, kSkip8 = 64;
  conv2_ = register_module("conv2", Conv2d(kBottom + kRayChannels, kBottom, 1));
  up1_ = register_module("up1", UpStage(kBottom + kSkip16 + kRayChannels, kMiddle));
  up2_ = register_module("up2", UpStage(kMiddle + kSkip8 + kRayChannels, kTop));
  normal_head_ = register_module("normal_head", PredictionHead(kTop + kRayChannels, kHeadWidth, 3));
  feature_head_ = register_module("feature_head", PredictionHead(kTop + kRayChannels, kHeadWidth, kStateWidth));
  hidden_head_ = register_module("hidden_head", PredictionHead(kTop + kRayChannels, kHeadWidth, kStateWidth));
}

DecoderMaps NormalDecoderImpl::forward(const EncoderMaps& maps, const RaySlopes& rays) {
  Tensor x = conv2_(with_rays(maps.thirty_second, rays.thirty_second));
  x = up1_(x, with_rays(maps.sixteenth, rays.sixteenth));
  x = with_rays(up2_(x, with_rays(maps.eighth, rays.eighth)), rays.eighth);
  return {unit_vectors(normal_head_(x)), feature_head_(x), hidden_head_(x)};
}

}  // namespace anigen::models
