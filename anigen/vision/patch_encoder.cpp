#include "anigen/vision/patch_encoder.h"

#include <algorithm>

#include "anigen/core/config.h"
#include "anigen/core/error.h"
#include "anigen/nn/embeddings.h"
#include "anigen/nn/gelu_erf.h"
#include "anigen/nn/norms.h"
#include "anigen/nn/ragged_attention.h"

namespace anigen::vision {

namespace {

constexpr std::int64_t kKernel = 3, kNarrowest = 16, kChannelsPerGroup = 16;
constexpr std::int64_t kColors = 3, kEstimated = 6;  // normals and coordinates
constexpr std::size_t kSampledLevels = 2;            // of the stem, the coarsest but the tokens themselves
constexpr std::int64_t kSeen = 3;                    // u, v and nearness of a cell

constexpr double kTokenNormEps = 1e-5;

/// (row, column) of every patch, row by row. [n², 2] int64
Tensor patch_places(std::int64_t n) {
  const Tensor index = torch::arange(n * n, torch::kInt64);
  return torch::stack({torch::div(index, n, "floor"), torch::remainder(index, n)}, 1);
}

}  // namespace

ConvolutionStemImpl::ConvolutionStemImpl(std::int64_t width, std::int64_t patch_size, std::int64_t in_channels) {
  TORCH_CHECK(patch_size > 1 && (patch_size & (patch_size - 1)) == 0, "a convolution stem halves: ", patch_size,
              " is no power of two");
  std::int64_t channels = in_channels;
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

Tensor ConvolutionStemImpl::forward(const Tensor& images, std::vector<Tensor>* levels) {
  Tensor x = images;
  for (std::size_t i = 0; i < layers_.size(); ++i) {
    x = layers_[i]->forward(x);
    if (i + 1 == layers_.size()) break;
    x = nn::gelu_erf(torch::group_norm(x, x.size(1) / kChannelsPerGroup));
    if (levels != nullptr) levels->push_back(x);
  }
  return x.flatten(2).transpose(1, 2);
}

std::vector<std::int64_t> ConvolutionStemImpl::level_channels() const {
  std::vector<std::int64_t> channels;
  for (std::size_t i = 0; i + 1 < layers_.size(); ++i) channels.push_back(layers_[i]->options.out_channels());
  return channels;
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
  if (!f.writes() || !estimator.empty()) f("estimator", estimator);
  if (!f.writes() || lift > 0) f("lift", lift, {0, 64});
  if (!f.writes() || !flow.empty()) f("flow", flow);
}

void PatchImageEncoderOptions::validate(const std::string& file, const std::string& pointer) const {
  const OptionCheck check{file, pointer};
  check(
      image_size % patch_size == 0, "patch_size",
      "patches of " + std::to_string(patch_size) + " pixels do not divide a picture of " + std::to_string(image_size));
  check(!convolutions || (patch_size >= 2 && (patch_size & (patch_size - 1)) == 0), "patch_size",
        std::to_string(patch_size) + " is no power of two, as stem \"convolutions\" needs it");
  check.heads("num_heads", num_heads, width);
  check(estimator.empty() || convolutions, "estimator", "needs \"stem\": \"convolutions\"");
  check(lift == 0 || !estimator.empty(), "lift", "needs an estimator, which knows the camera");
  check(lift == 0 || patch_size >= (std::int64_t{2} << kSampledLevels), "lift",
        "needs patches of at least " + std::to_string(2 << kSampledLevels) + " pixels");
}

PatchImageEncoderImpl::PatchImageEncoderImpl(const PatchImageEncoderOptions& options, std::int64_t cond_channels,
                                             nn::Init init, std::int64_t flow_channels)
    : options_(options) {
  options_.validate();
  TORCH_CHECK(options_.flow.empty() == (flow_channels == 0), "the width of another flow's tokens goes with `flow`");
  // A convolution whose windows do not overlap is one product per window.
  const std::int64_t values = 3 * options_.patch_size * options_.patch_size;
  if (options_.convolutions) {
    const std::int64_t channels = kColors + (options_.estimator.empty() ? 0 : kEstimated);
    stem_ = register_module("stem", ConvolutionStem(options_.width, options_.patch_size, channels));
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
  if (options_.lift > 0) {
    const std::vector<std::int64_t> levels = stem_->level_channels();
    std::int64_t sampled = options_.width + kSeen;
    for (std::size_t i = levels.size() - kSampledLevels; i < levels.size(); ++i) sampled += levels[i];
    lift_layer_ = register_module("lift_layer", nn::Linear(sampled, options_.width));
    const Tensor grid = nn::grid_coordinates(options_.lift);
    cell_emb_ = register_buffer("cell_emb", nn::absolute_position_embedding(grid, options_.width));
    cells_ = register_buffer("cells", (grid.to(torch::kFloat32) + 0.5) / static_cast<double>(options_.lift) - 0.5);
  }
  out_layer_ = register_module("out_layer", nn::Linear(options_.width, cond_channels));
  if (flow_channels > 0) flow_layer_ = register_module("flow_layer", nn::Linear(flow_channels, cond_channels));
  if (init == nn::Init::kPublished) nn::xavier_uniform_linears(*this);
}

Tensor PatchImageEncoderImpl::embed_patches(const Tensor& images, std::vector<Tensor>& levels) {
  if (options_.convolutions) return stem_->forward(images, &levels);
  const std::int64_t patch = options_.patch_size, n = options_.image_size / patch, batch = images.size(0);
  return patch_embed_->forward(images.reshape({batch, 3, n, patch, n, patch})
                                   .permute({0, 2, 4, 1, 3, 5})
                                   .reshape({batch, n * n, 3 * patch * patch}));
}

Tensor PatchImageEncoderImpl::lifted(const Tensor& tokens, const std::vector<Tensor>& levels, const Tensor& camera) {
  const Tensor seen = seen_from(camera, cells_.to(camera.scalar_type()));  // [B, cells, 3]
  const Tensor places = (2.0 * seen.narrow(2, 0, 2) - 1.0).unsqueeze(1);   // of grid_sample, [B, 1, cells, 2]
  const auto sampled = [&](const Tensor& map) {
    namespace F = torch::nn::functional;
    return F::grid_sample(
               map, places,
               F::GridSampleFuncOptions().mode(torch::kBilinear).padding_mode(torch::kZeros).align_corners(false))
        .squeeze(2)
        .transpose(1, 2);
  };
  const std::int64_t n = options_.image_size / options_.patch_size;
  std::vector<Tensor> parts{sampled(tokens.transpose(1, 2).reshape({tokens.size(0), options_.width, n, n}))};
  for (std::size_t i = levels.size() - kSampledLevels; i < levels.size(); ++i) parts.push_back(sampled(levels[i]));
  parts.push_back(seen);
  return lift_layer_->forward(torch::cat(parts, 2)) + cell_emb_;
}

Tensor PatchImageEncoderImpl::forward(const Tensor& images, const PictureEstimate& estimate,
                                      const Tensor& flow_tokens) {
  const std::int64_t size = options_.image_size;
  if (images.dim() != 4 || images.size(1) != 3 || images.size(2) != size || images.size(3) != size) {
    throw InputError("", "image",
                     "the image encoder takes pictures [B, 3, " + std::to_string(size) + ", " + std::to_string(size) +
                         "]; set dataset.args.image_size to its image_size");
  }
  TORCH_CHECK(options_.estimator.empty() || estimate.normals.defined(), "the image encoder needs an estimate");
  TORCH_CHECK(flow_layer_.is_empty() || flow_tokens.defined(), "the image encoder needs the tokens of another flow");
  const std::int64_t batch = images.size(0), patches = options_.patches();
  Tensor seen = 2.0 * images - 1.0;
  if (!options_.estimator.empty()) {
    // Maps mean nothing where there is no object, which is black.
    const Tensor object = (images.amax(1, /*keepdim=*/true) > 0.0).to(images.scalar_type());
    const Tensor maps = torch::upsample_bilinear2d(torch::cat({estimate.normals, 2.0 * estimate.coordinates}, 1),
                                                   {size, size}, /*align_corners=*/false);
    seen = torch::cat({seen, maps * object}, 1);
  }
  std::vector<Tensor> levels;
  Tensor x = (embed_patches(seen, levels) + pos_emb_).reshape({batch * patches, options_.width});
  const nn::Ragged items(std::vector<std::int64_t>(static_cast<std::size_t>(batch), patches));
  for (nn::TransformerBlock& block : blocks_) x = block->forward(x, items);
  Tensor tokens = nn::layer_norm(x).reshape({batch, patches, options_.width});
  if (options_.lift > 0) tokens = torch::cat({tokens, nn::layer_norm(lifted(tokens, levels, estimate.camera))}, 1);
  tokens = out_layer_->forward(tokens);
  if (!flow_layer_.is_empty()) tokens = torch::cat({tokens, flow_layer_->forward(flow_tokens)}, 1);
  return nn::layer_norm(tokens, kTokenNormEps);
}

}  // namespace anigen::vision
