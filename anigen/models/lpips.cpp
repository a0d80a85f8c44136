#include "anigen/models/lpips.h"

#include <limits>
#include <memory>
#include <string>

#include "anigen/core/error.h"

namespace anigen::models {
namespace {

constexpr std::int64_t kSmallestPicture = 16;  // four halvings leave one pixel
constexpr double kNormEpsilon = 1e-10;         // outside the square root, as published

/// Place of a stage's convolutions in torchvision's list of layers (with ReLU and pooling between them), and their
/// number of output channels.
struct Stage {
  std::vector<int> layers;
  std::int64_t width;
};
const std::array<Stage, kLpipsStages>& vgg16() {
  static const std::array<Stage, kLpipsStages> kStages = {
      {{{0, 2}, 64}, {{5, 7}, 128}, {{10, 12, 14}, 256}, {{17, 19, 21}, 512}, {{24, 26, 28}, 512}}};
  return kStages;
}

Tensor unset(torch::IntArrayRef shape) { return torch::full(shape, std::numeric_limits<float>::quiet_NaN()); }

std::shared_ptr<torch::nn::Module> empty_module() { return std::make_shared<torch::nn::Module>(); }

/// From [0, 1] to what VGG16 was trained on: first to [-1, 1], then shifted and divided per channel.
Tensor normalized(const Tensor& picture) {
  const Tensor shift = torch::tensor({-0.030, -0.088, -0.188}, torch::kFloat64).to(picture.options()).view({3, 1, 1});
  const Tensor scale = torch::tensor({0.458, 0.448, 0.450}, torch::kFloat64).to(picture.options()).view({3, 1, 1});
  return (2.0 * picture - 1.0 - shift) / scale;
}

/// Divided by the norm over channels. The gradient of a norm at 0, where no channel is active, is taken as 0; the
/// published square root of a sum of squares gives NaN there.
Tensor unit_features(const Tensor& features) {
  return features / (torch::norm(features, 2, {1}, /*keepdim=*/true) + kNormEpsilon);
}

void check_pictures(const Tensor& a, const Tensor& b) {
  if (a.dim() != 4 || a.size(1) != 3 || a.sizes() != b.sizes())
    throw InputError("", "image", "LPIPS compares two batches [N, 3, H, W] of one shape");
  if (a.size(2) < kSmallestPicture || a.size(3) < kSmallestPicture)
    throw InputError("", "image", "LPIPS needs pictures of at least 16 × 16 pixels");
}

}  // namespace

Vgg16FeaturesImpl::Vgg16FeaturesImpl() {
  std::int64_t in = 3;
  for (std::size_t s = 0; s < kLpipsStages; ++s) {
    const auto& [layers, out] = vgg16()[s];
    for (const int layer : layers) {
      const auto module = register_module(std::to_string(layer), empty_module());
      stages_[s].push_back({module->register_parameter("weight", unset({out, in, 3, 3}), /*requires_grad=*/false),
                            module->register_parameter("bias", unset({out}), /*requires_grad=*/false)});
      in = out;
    }
  }
}

Tensor Vgg16FeaturesImpl::stage(std::size_t index, Tensor x) const {
  if (index > 0) x = torch::max_pool2d(x, 2);
  for (const Convolution& layer : stages_[index])
    x = torch::relu(torch::conv2d(x, layer.weight, layer.bias, /*stride=*/1, /*padding=*/1));
  return x;
}

LpipsImpl::LpipsImpl() {
  features_ = register_module("features", Vgg16Features());
  for (std::size_t s = 0; s < kLpipsStages; ++s) {
    const auto head = register_module("lin" + std::to_string(s), empty_module());
    const auto model = head->register_module("model", empty_module());
    const auto convolution = model->register_module("1", empty_module());  // 0 is the dropout
    heads_[s] = convolution->register_parameter("weight", unset({1, vgg16()[s].width, 1, 1}), /*requires_grad=*/false);
  }
  eval();
}

Tensor LpipsImpl::stages(const Tensor& a, const Tensor& b) {
  check_pictures(a, b);
  Tensor x = normalized(a), y = normalized(b);
  std::vector<Tensor> distances;
  for (std::size_t s = 0; s < kLpipsStages; ++s) {
    x = features_->stage(s, x);
    y = features_->stage(s, y);
    const Tensor difference = (unit_features(x) - unit_features(y)).square();
    distances.push_back(torch::conv2d(difference, heads_[s]).mean({1, 2, 3}));
  }
  return torch::stack(distances);
}

Tensor LpipsImpl::forward(const Tensor& a, const Tensor& b) { return stages(a, b).sum(0); }

}  // namespace anigen::models
