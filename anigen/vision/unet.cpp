#include "anigen/vision/unet.h"

#include "anigen/core/error.h"
#include "anigen/nn/embeddings.h"
#include "anigen/nn/gelu_erf.h"
#include "anigen/nn/norms.h"
#include "anigen/nn/ragged_attention.h"

namespace anigen::vision {

namespace {

constexpr std::int64_t kLevels = 4, kPatch = 1 << kLevels;  // each level halves
constexpr std::int64_t kColorChannels = 3, kGroup = 8;

std::int64_t channels_of(std::int64_t level, std::int64_t width) { return width >> (kLevels - 1 - level); }

}  // namespace

void UNetOptions::fields(ConfigFields& f) {
  f("image_size", image_size, {kPatch, 4096});
  f("width", width, {64, 4096});
  f("num_blocks", num_blocks, {0, 64});
  f("num_heads", num_heads, {1, 256});
  f("mlp_ratio", mlp_ratio, {0.1, 64.0});
}

void UNetOptions::validate(const std::string& file, const std::string& pointer) const {
  const OptionCheck check{file, pointer};
  check(image_size % kPatch == 0, "image_size", "must be a multiple of " + std::to_string(kPatch));
  check(width % (kGroup << (kLevels - 1)) == 0, "width",
        "must be a multiple of " + std::to_string(kGroup << (kLevels - 1)));
  check.heads("num_heads", num_heads, width);
}

std::int64_t UNetOptions::map_channels() const { return channels_of(0, width); }

torch::nn::Conv2d convolution(std::int64_t in, std::int64_t out, std::int64_t kernel, std::int64_t stride) {
  return torch::nn::Conv2d(torch::nn::Conv2dOptions(in, out, kernel).stride(stride).padding(kernel / 2));
}

Tensor activated(const Tensor& x) { return nn::gelu_erf(torch::group_norm(x, x.size(1) / kGroup)); }

Tensor doubled(const Tensor& x) {
  namespace F = torch::nn::functional;
  return F::interpolate(x, F::InterpolateFuncOptions()
                               .scale_factor(std::vector<double>{2.0, 2.0})
                               .mode(torch::kBilinear)
                               .align_corners(false));
}

UNetImpl::UNetImpl(const UNetOptions& options) : options_(options) {
  for (std::int64_t level = 0; level < kLevels; ++level) {
    const std::int64_t own = channels_of(level, options_.width);
    down_.push_back(convolution(level == 0 ? kColorChannels : channels_of(level - 1, options_.width), own, 3, 2));
    refine_.push_back(convolution(own, own, 3));
    if (level + 1 == kLevels) break;
    across_.push_back(convolution(channels_of(level + 1, options_.width), own, 1));
    up_.push_back(convolution(own, own, 3));
  }
  register_module("down", nn::module_list(down_));
  register_module("refine", nn::module_list(refine_));
  register_module("across", nn::module_list(across_));
  register_module("up", nn::module_list(up_));
  for (std::int64_t i = 0; i < options_.num_blocks; ++i)
    blocks_.emplace_back(options_.width, options_.num_heads, options_.mlp_ratio);
  register_module("blocks", nn::module_list(blocks_));
  const std::int64_t n = options_.image_size / kPatch;
  const Tensor index = torch::arange(n * n, torch::kInt64);
  pos_emb_ = register_buffer(
      "pos_emb", nn::absolute_position_embedding(
                     torch::stack({torch::div(index, n, "floor"), torch::remainder(index, n)}, 1), options_.width));
}

UNetFeatures UNetImpl::forward(const Tensor& images) {
  const std::int64_t size = options_.image_size, batch = images.dim() == 4 ? images.size(0) : 0;
  if (images.dim() != 4 || images.size(1) != kColorChannels || images.size(2) != size || images.size(3) != size) {
    throw InputError("", "image",
                     "this network takes pictures [B, 3, " + std::to_string(size) + ", " + std::to_string(size) +
                         "], not " + c10::str(images.sizes()));
  }
  std::vector<Tensor> levels;
  Tensor x = 2.0 * images - 1.0;
  for (std::size_t level = 0; level < down_.size(); ++level) {
    x = activated(down_[level]->forward(x));
    x = x + activated(refine_[level]->forward(x));
    levels.push_back(x);
  }
  const std::int64_t n = size / kPatch, tokens = n * n;
  Tensor rows = x.flatten(2).transpose(1, 2) + pos_emb_;
  rows = rows.reshape({batch * tokens, options_.width});
  const nn::Ragged items(std::vector<std::int64_t>(static_cast<std::size_t>(batch), tokens));
  for (nn::TransformerBlock& block : blocks_) rows = block->forward(rows, items);
  UNetFeatures features;
  features.tokens = nn::layer_norm(rows).reshape({batch, tokens, options_.width});
  x = features.tokens.transpose(1, 2).reshape({batch, options_.width, n, n});
  for (std::size_t level = up_.size(); level-- > 0;) {
    x = doubled(across_[level]->forward(x)) + levels[level];
    x = x + activated(up_[level]->forward(x));
  }
  features.map = x;
  return features;
}

}  // namespace anigen::vision
