#include "anigen/models/image_stem.h"

#include <algorithm>

namespace anigen::models {
namespace {

constexpr std::int64_t kColors = 3, kKernel = 3, kNarrowest = 16, kChannelsPerGroup = 16;

}  // namespace

ConvolutionStemImpl::ConvolutionStemImpl(std::int64_t width, std::int64_t patch_size) {
  TORCH_CHECK(patch_size > 1 && (patch_size & (patch_size - 1)) == 0, "a convolution stem halves: ", patch_size,
              " is no power of two");
  std::int64_t channels = kColors;
  torch::nn::ModuleList list;
  for (std::int64_t left = patch_size / 2; left >= 1; left /= 2) {
    // Half the channels at twice the resolution; whole groups for the norm.
    const std::int64_t narrow = std::max(kNarrowest, width / left / kChannelsPerGroup * kChannelsPerGroup);
    const std::int64_t wide = left == 1 ? width : narrow;
    layers_.emplace_back(torch::nn::Conv2dOptions(channels, wide, kKernel).stride(2).padding(kKernel / 2));
    list->push_back(layers_.back());
    channels = wide;
  }
  register_module("layers", list);
}

Tensor ConvolutionStemImpl::forward(const Tensor& images) {
  Tensor x = images;
  for (std::size_t i = 0; i < layers_.size(); ++i) {
    x = layers_[i]->forward(x);
    if (i + 1 < layers_.size()) x = torch::gelu(torch::group_norm(x, x.size(1) / kChannelsPerGroup));
  }
  return x.flatten(2).transpose(1, 2);
}

}  // namespace anigen::models
