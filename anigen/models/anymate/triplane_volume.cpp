#include "anigen/models/anymate/triplane_volume.h"

#include <memory>

#include "anigen/models/anymate/checks.h"
#include "anigen/nn/kept_contexts.h"

namespace anigen::models::anymate {
namespace {

constexpr std::int64_t kPlanes = 3, kHeadHidden = 64;

StyleGeneratorOptions with_planes(StyleGeneratorOptions options) {
  options.img_channels = kPlanes * kPlaneChannels;
  return options;
}

}  // namespace

Tensor triplane_axes() {
  return torch::tensor({1.0F, 0.0F, 0.0F, 0.0F, 1.0F, 0.0F, 0.0F, 0.0F, 1.0F,   // x, y
                        1.0F, 0.0F, 0.0F, 0.0F, 0.0F, 1.0F, 0.0F, 1.0F, 0.0F,   // x, z
                        0.0F, 0.0F, 1.0F, 1.0F, 0.0F, 0.0F, 0.0F, 1.0F, 0.0F})  // z, x
      .view({kPlanes, 3, 3});
}

Tensor sample_planes(const Tensor& planes, const Tensor& queries) {
  require_shape(planes, {-1, kPlanes, -1, -1, -1}, "planes");
  require_shape(queries, {planes.size(0), -1, 3}, "queries");
  const std::int64_t items = planes.size(0), count = queries.size(1);
  const Tensor axes = triplane_axes().to(queries.options()).slice(1, 0, 2);       // [3, 2, 3]
  const Tensor grid = torch::matmul(queries.unsqueeze(1), axes.transpose(1, 2));  // [B, 3, V, 2]
  namespace F = torch::nn::functional;
  const auto options =
      F::GridSampleFuncOptions().mode(torch::kBilinear).padding_mode(torch::kZeros).align_corners(false);
  const Tensor found = F::grid_sample(planes.flatten(0, 1), grid.view({items * kPlanes, 1, count, 2}), options);
  return found.view({items, kPlanes, planes.size(2), count}).transpose(2, 3);
}

PlaneHeadImpl::PlaneHeadImpl() {
  const auto net = register_module("net", std::make_shared<torch::nn::Module>());
  first_ = net->register_module("0", EqualizedLinear(kPlaneChannels, kHeadHidden));
  second_ = net->register_module("2", EqualizedLinear(kHeadHidden, 1));
}

void PlaneHeadImpl::initialize() {
  first_->initialize();
  second_->initialize();
}

Tensor PlaneHeadImpl::forward(const Tensor& sampled) {
  require_shape(sampled, {-1, kPlanes, -1, kPlaneChannels}, "sampled");
  return second_(torch::softplus(first_(sampled.mean(1))));
}

TriplaneVolumeImpl::TriplaneVolumeImpl(const StyleGeneratorOptions& options, nn::Init init) {
  backbone_ = register_module("backbone", StyleGenerator(with_planes(options)));
  decoder_ = register_module("decoder", PlaneHead());
  if (init == nn::Init::kNone) return;
  backbone_->initialize();
  decoder_->initialize();
}

Tensor TriplaneVolumeImpl::styles(const Tensor& z) {
  return backbone_->style(z).unsqueeze(1).expand({-1, backbone_->num_ws(), -1});
}

Tensor TriplaneVolumeImpl::planes(const Tensor& z, std::optional<StyleNoise> noise) {
  const StyleNoise kind = noise.value_or(is_training() ? StyleNoise::kRandom : StyleNoise::kConst);
  const Tensor image = backbone_->image(backbone_->style(z), kind);
  return image.view({z.size(0), kPlanes, kPlaneChannels, image.size(2), image.size(3)});
}

Tensor TriplaneVolumeImpl::forward(const Tensor& latents, const Tensor& queries) {
  return logits(nn::context_of(this, latents, [&] { return planes(latents); }), queries);
}

}  // namespace anigen::models::anymate
