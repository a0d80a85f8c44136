#include "anigen/models/sparse_structure_resnet.h"

#include <string>

#include "anigen/nn/init.h"
#include "anigen/nn/volume_layout.h"

namespace anigen::models {

using torch::Tensor;

VolumeResBlockImpl::VolumeResBlockImpl(std::int64_t in_channels, std::int64_t out_channels) {
  norm1_ = register_module("norm1", nn::VolumeNorm(in_channels));
  norm2_ = register_module("norm2", nn::VolumeNorm(out_channels));
  conv1_ = register_module("conv1", nn::Conv3d(in_channels, out_channels, 3, 1, 1));
  conv2_ = register_module("conv2", nn::Conv3d(out_channels, out_channels, 3, 1, 1));
  if (in_channels != out_channels) {
    skip_connection_ = register_module("skip_connection", nn::Conv3d(in_channels, out_channels, 1));
  }
}

Tensor VolumeResBlockImpl::forward(const Tensor& x) {
  const Tensor h = conv1_->forward(norm1_->activated(x));
  const Tensor skip = skip_connection_.is_empty() ? x : skip_connection_->forward(x);
  return skip + conv2_->forward(norm2_->activated(h));
}

void VolumeResBlockImpl::initialize() {
  torch::nn::init::zeros_(conv2_->weight);
  torch::nn::init::zeros_(conv2_->bias);
}

VolumeDownsampleImpl::VolumeDownsampleImpl(std::int64_t in_channels, std::int64_t out_channels) {
  conv_ = register_module("conv", nn::Conv3d(in_channels, out_channels, 2, 2));
}

VolumeUpsampleImpl::VolumeUpsampleImpl(std::int64_t in_channels, std::int64_t out_channels) {
  conv_ = register_module("conv", nn::Conv3d(in_channels, 8 * out_channels, 3, 1, 1));
}

Tensor VolumeUpsampleImpl::forward(const Tensor& x) { return nn::pixel_shuffle_3d(conv_->forward(x), 2); }

VolumeHeadImpl::VolumeHeadImpl(std::int64_t in_channels, std::int64_t out_channels, nn::VolumeNormImpl::Kind norm) {
  norm_ = register_module("0", nn::VolumeNorm(in_channels, norm));
  conv_ = register_module("2", nn::Conv3d(in_channels, out_channels, 3, 1, 1));
}

Tensor VolumeHeadImpl::forward(const Tensor& x) { return conv_->forward(norm_->activated(x)).contiguous(); }

template <typename Holder>
void VolumeTorsoImpl::add(Holder layer) {
  register_module(std::to_string(layers_.size()), layer);
  layers_.push_back([layer](const Tensor& x) mutable { return layer->forward(x); });
  for (const Tensor& parameter : layer->parameters()) {
    if (!first_kernel_.defined() && parameter.dim() == 5) first_kernel_ = parameter;
  }
}

void VolumeTorsoImpl::add_res_blocks(std::int64_t count, std::int64_t channels) {
  for (std::int64_t i = 0; i < count; ++i) add(VolumeResBlock(channels, channels));
}

void VolumeTorsoImpl::add_downsample(std::int64_t in_channels, std::int64_t out_channels) {
  add(VolumeDownsample(in_channels, out_channels));
}

void VolumeTorsoImpl::add_upsample(std::int64_t in_channels, std::int64_t out_channels) {
  add(VolumeUpsample(in_channels, out_channels));
}

Tensor VolumeTorsoImpl::forward(const Tensor& x) {
  if (layers_.empty()) return x;
  Tensor h = x.to(first_kernel_.scalar_type());
  for (const auto& layer : layers_) h = layer(h);
  return h;
}

void initialize_volume_layers(torch::nn::Module& module) {
  nn::default_convolutions(module);
  nn::default_norms(module);
  module.apply([](torch::nn::Module& part) {
    if (auto* block = part.as<VolumeResBlockImpl>()) block->initialize();
  });
}

}  // namespace anigen::models
