#include "anigen/models/dinov2.h"

#include <vector>

#include "anigen/models/dinov2_positions.h"
#include "anigen/nn/layer_norm.h"

namespace anigen::models {

Dinov2Impl::Dinov2Impl(const Dinov2Options& options) : options_(options) {
  options_.validate();
  const std::int64_t channels = options_.embed_dim, side = options_.patches_per_side();
  cls_token_ = register_parameter("cls_token", torch::empty({1, 1, channels}));
  pos_embed_ = register_parameter("pos_embed", torch::empty({1, 1 + side * side, channels}));
  if (options_.num_register_tokens > 0) {
    register_tokens_ = register_parameter("register_tokens", torch::empty({1, options_.num_register_tokens, channels}));
  }
  mask_token_ = register_parameter("mask_token", torch::empty({1, channels}));
  patch_embed_ = register_module("patch_embed", PatchEmbed(channels, options_.patch_size));
  blocks_ = register_module("blocks", torch::nn::ModuleList());
  for (std::int64_t i = 0; i < options_.depth; ++i) blocks_->push_back(Dinov2Block(options_));
  norm_ = register_module("norm", nn::AffineLayerNorm(channels, nn::kBlockNormEps));
}

Tensor Dinov2Impl::positions(std::int64_t rows, std::int64_t columns) const {
  return interpolate_positions(pos_embed_, rows, columns, options_.interpolate_antialias, options_.interpolate_offset);
}

Tensor Dinov2Impl::tokens_after(const Tensor& images, std::int64_t blocks) {
  const std::int64_t patch = options_.patch_size;
  TORCH_CHECK(images.dim() == 4 && images.size(1) == 3 && images.size(2) % patch == 0 && images.size(3) % patch == 0,
              "DINOv2 takes [B, 3, H, W] with sides that are multiples of ", patch, ", got ", images.sizes());
  TORCH_CHECK(blocks >= 0 && blocks <= options_.depth, "there are ", options_.depth, " blocks, not ", blocks);
  const std::int64_t batch = images.size(0);
  Tensor x = torch::cat({cls_token_.expand({batch, -1, -1}), patch_embed_->forward(images)}, 1);
  x = x + positions(images.size(2) / patch, images.size(3) / patch);
  if (register_tokens_.defined()) {
    x = torch::cat({x.slice(1, 0, 1), register_tokens_.expand({batch, -1, -1}), x.slice(1, 1)}, 1);
  }
  for (std::int64_t i = 0; i < blocks; ++i) x = blocks_[static_cast<std::size_t>(i)]->as<Dinov2BlockImpl>()->forward(x);
  return x;
}

Dinov2Tokens Dinov2Impl::forward(const Tensor& images) {
  Dinov2Tokens tokens;
  tokens.x_prenorm = tokens_after(images, options_.depth);
  tokens.x_norm = norm_->forward(tokens.x_prenorm);
  tokens.registers = options_.num_register_tokens;
  tokens.rows = images.size(2) / options_.patch_size;
  tokens.columns = images.size(3) / options_.patch_size;
  return tokens;
}

Tensor imagenet_normalized(const Tensor& images) {
  const auto per_channel = [&](std::vector<double> values) {
    return torch::tensor(values, images.options()).view({3, 1, 1});
  };
  return (images - per_channel({0.485, 0.456, 0.406})) / per_channel({0.229, 0.224, 0.225});
}

}  // namespace anigen::models
