#include "anigen/vision/patch_encoder.h"

#include <algorithm>

#include "anigen/core/config.h"
#include "anigen/core/error.h"
#include "anigen/nn/embeddings.h"
#include "anigen/nn/norms.h"
#include "anigen/nn/ragged_attention.h"

namespace anigen::vision {

namespace {

constexpr std::int64_t kColors = 3, kKernel = 3, kNarrowest = 16, kChannelsPerGroup = 16;

constexpr double kTokenNormEps = 1e-5;

/// (row, column) of every patch, row by row. [n², 2] int64
Tensor patch_places(std::int64_t n) {
  const Tensor index = torch::arange(n * n, torch::kInt64);
  return torch::stack({torch::div(index, n, "floor"), torch::remainder(index, n)}, 1);
}

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

void PatchImageEncoderOptions::fields(ConfigFields& f) {
  std::string name = "patch";
  f("name", name);
  f("image_size", image_size, {1, 4096});
  f("patch_size", patch_size, {1, 256});
  f("width", width, {4, 16384});
  f("num_blocks", num_blocks, {0, 64});
  f("num_heads", num_heads, {1, 256});
  f("mlp_ratio", mlp_ratio, {0.1, 64.0});
  std::string stem = convolutions ? "convolutions" : "linear";
  f("stem", stem, {"linear", "convolutions"});
  convolutions = stem == "convolutions";
}

void PatchImageEncoderOptions::validate(const std::string& file, const std::string& pointer) const {
  const OptionCheck check{file, pointer};
  check(
      image_size % patch_size == 0, "patch_size",
      "patches of " + std::to_string(patch_size) + " pixels do not divide a picture of " + std::to_string(image_size));
  check(!convolutions || (patch_size >= 2 && (patch_size & (patch_size - 1)) == 0), "patch_size",
        std::to_string(patch_size) + " is no power of two, as stem \"convolutions\" needs it");
  check.heads("num_heads", num_heads, width);
}

PatchImageEncoderImpl::PatchImageEncoderImpl(const PatchImageEncoderOptions& options, std::int64_t cond_channels,
                                             nn::Init init)
    : options_(options) {
  options_.validate();
  // A convolution whose windows do not overlap is one product per window.
  const std::int64_t values = 3 * options_.patch_size * options_.patch_size;
  if (options_.convolutions) {
    stem_ = register_module("stem", ConvolutionStem(options_.width, options_.patch_size));
  } else {
    patch_embed_ = register_module("patch_embed", nn::Linear(values, options_.width));
  }
  const Tensor places = patch_places(options_.image_size / options_.patch_size);
  pos_emb_ = register_buffer("pos_emb", nn::absolute_position_embedding(places, options_.width));
  torch::nn::ModuleList list;
  for (std::int64_t i = 0; i < options_.num_blocks; ++i) {
    blocks_.emplace_back(options_.width, options_.num_heads, options_.mlp_ratio);
    list->push_back(blocks_.back());
  }
  register_module("blocks", list);
  out_layer_ = register_module("out_layer", nn::Linear(options_.width, cond_channels));
  if (init == nn::Init::kPublished) nn::xavier_uniform_linears(*this);
}

Tensor PatchImageEncoderImpl::embed_patches(const Tensor& images) {
  if (options_.convolutions) return stem_->forward(images);
  const std::int64_t patch = options_.patch_size, n = options_.image_size / patch, batch = images.size(0);
  return patch_embed_->forward(images.reshape({batch, 3, n, patch, n, patch})
                                   .permute({0, 2, 4, 1, 3, 5})
                                   .reshape({batch, n * n, 3 * patch * patch}));
}

Tensor PatchImageEncoderImpl::forward(const Tensor& images) {
  const std::int64_t size = options_.image_size;
  if (images.dim() != 4 || images.size(1) != 3 || images.size(2) != size || images.size(3) != size) {
    throw InputError("", "image",
                     "the image encoder takes pictures [B, 3, " + std::to_string(size) + ", " + std::to_string(size) +
                         "]; set dataset.args.image_size to its image_size");
  }
  const std::int64_t batch = images.size(0), tokens = options_.tokens();
  Tensor x = (embed_patches(2.0 * images - 1.0) + pos_emb_).reshape({batch * tokens, options_.width});
  const nn::Ragged items(std::vector<std::int64_t>(static_cast<std::size_t>(batch), tokens));
  for (nn::TransformerBlock& block : blocks_) x = block->forward(x, items);
  const Tensor out = out_layer_->forward(nn::layer_norm(x));
  return nn::layer_norm(out, kTokenNormEps).reshape({batch, tokens, out.size(1)});
}

}  // namespace anigen::vision
