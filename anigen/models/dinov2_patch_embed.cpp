#include "anigen/models/dinov2_patch_embed.h"

#include <memory>

namespace anigen::models {

PatchEmbedImpl::PatchEmbedImpl(std::int64_t channels, std::int64_t patch_size) : patch_size_(patch_size) {
  constexpr std::int64_t kColors = 3;
  projection_ = register_module("proj", std::make_shared<Projection>());
  projection_->weight =
      projection_->register_parameter("weight", torch::empty({channels, kColors, patch_size, patch_size}));
  projection_->bias = projection_->register_parameter("bias", torch::empty({channels}));
}

Tensor PatchEmbedImpl::forward(const Tensor& images) {
  const Tensor grid = torch::conv2d(images, projection_->weight, projection_->bias, /*stride=*/patch_size_);
  return grid.flatten(2).transpose(1, 2);
}

}  // namespace anigen::models
