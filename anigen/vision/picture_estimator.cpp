#include "anigen/vision/picture_estimator.h"

namespace anigen::vision {

namespace {

constexpr std::int64_t kMapChannels = 6;
constexpr double kShortest = 1e-6, kLeastDepth = 0.1;

Tensor unit(const Tensor& x, std::int64_t axis) {
  return x / x.square().sum(axis, /*keepdim=*/true).clamp_min(kShortest * kShortest).sqrt();
}

}  // namespace

Tensor seen_from(const Tensor& cameras, const Tensor& points) {
  TORCH_CHECK(cameras.dim() == 2 && cameras.size(1) == kCameraNumbers && points.dim() == 2 && points.size(1) == 3,
              "seen_from: cameras ", cameras.sizes(), " and points ", points.sizes());
  const Tensor turn = unit(cameras.narrow(1, 0, 2), 1), pitch = cameras.select(1, 2);
  const Tensor sine = turn.select(1, 0), cosine = turn.select(1, 1), up = pitch.sin(), level = pitch.cos();
  const Tensor zero = torch::zeros_like(sine);
  // Columns right, up and back of the camera in the object's frame, [B, 3] each.
  const Tensor x_axis = torch::stack({-sine, cosine, zero}, 1);
  const Tensor y_axis = torch::stack({-cosine * up, -sine * up, level}, 1);
  const Tensor z_axis = torch::stack({cosine * level, sine * level, up}, 1);
  const Tensor places = points.t();  // [3, N]
  const Tensor a = torch::matmul(x_axis, places), b = torch::matmul(y_axis, places), c = torch::matmul(z_axis, places);
  const Tensor depth = (1.0 - cameras.select(1, 6).unsqueeze(1) * c).clamp_min(kLeastDepth);
  const Tensor scale = cameras.select(1, 3).exp().unsqueeze(1) / depth;
  return torch::stack({cameras.select(1, 4).unsqueeze(1) + scale * a, cameras.select(1, 5).unsqueeze(1) - scale * b, c},
                      2);
}

void PictureEstimatorOptions::fields(ConfigFields& f) {
  UNetOptions::fields(f);
  f("families", families, {0, 100000});
}

void PictureEstimatorOptions::validate(const std::string& file, const std::string& pointer) const {
  UNetOptions::validate(file, pointer);
}

PictureEstimatorImpl::PictureEstimatorImpl(const PictureEstimatorOptions& options, nn::Init init) : options_(options) {
  options_.validate();
  unet_ = register_module("unet", UNet(options_));
  maps_ = register_module("maps", convolution(options_.map_channels(), kMapChannels, 1));
  whole_ = register_module("whole", nn::Linear(options_.width, options_.families + kCameraNumbers));
  if (init == nn::Init::kPublished) nn::xavier_uniform_linears(*this);
}

PictureEstimate PictureEstimatorImpl::forward(const Tensor& images) {
  const UNetFeatures features = unet_->forward(images);
  const Tensor maps = maps_->forward(features.map), whole = whole_->forward(features.tokens.mean(1));
  PictureEstimate estimate;
  estimate.normals = unit(maps.narrow(1, 0, 3), 1);
  estimate.coordinates = maps.narrow(1, 3, 3);
  estimate.family = whole.narrow(1, 0, options_.families);
  estimate.camera = whole.narrow(1, options_.families, kCameraNumbers);
  return estimate;
}

}  // namespace anigen::vision
