#include "anigen/vision/dinov2.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <memory>
#include <utility>

#include "anigen/core/config.h"
#include "anigen/core/error.h"
#include "anigen/io/arrays/torch_archive.h"
#include "anigen/nn/attention.h"
#include "anigen/nn/state_dict.h"

namespace anigen::vision {

namespace {

// Limits that no sensible model reaches, so that a mistyped size is an error and not an allocation failure.
constexpr std::int64_t kMostDinoChannels = 16384;
constexpr std::int64_t kMostDinoBlocks = 256;
constexpr std::int64_t kMostDinoSide = 16384;

struct Size {
  const char* letter;
  std::int64_t embed_dim, depth, num_heads;
  const char* ffn_layer;
};

constexpr std::array<Size, 4> kSizes = {{{"s", 384, 12, 6, "mlp"},
                                         {"b", 768, 12, 12, "mlp"},
                                         {"l", 1024, 24, 16, "mlp"},
                                         {"g", 1536, 40, 24, "swiglufused"}}};
constexpr std::int64_t kRegisters = 4;

std::string name_of(const Size& size, bool registers) {
  return std::string("dinov2_vit") + size.letter + "14" + (registers ? "_reg" : "");
}

// [1, C, M, M] → [1, C, rows, columns]
Tensor resample(const Tensor& grid, std::int64_t rows, std::int64_t columns, bool antialias, double offset) {
  const std::vector<std::int64_t> size = {rows, columns};
  if (offset == 0.0) {
    return antialias ? at::_upsample_bicubic2d_aa(grid, size, /*align_corners=*/false)
                     : at::upsample_bicubic2d(grid, size, /*align_corners=*/false);
  }
  const double along_rows = (static_cast<double>(rows) + offset) / static_cast<double>(grid.size(2));
  const double along_columns = (static_cast<double>(columns) + offset) / static_cast<double>(grid.size(3));
  return antialias ? at::_upsample_bicubic2d_aa(grid, size, /*align_corners=*/false, along_rows, along_columns)
                   : at::upsample_bicubic2d(grid, size, /*align_corners=*/false, along_rows, along_columns);
}

// Multi-head self attention with keys `qkv` (rows q, k, v; head j owns channels j·C/h … of each) and `proj`.
class Dinov2AttentionImpl : public torch::nn::Module {
 public:
  Dinov2AttentionImpl(std::int64_t channels, std::int64_t num_heads) : num_heads_(num_heads) {
    qkv_ = register_module("qkv", nn::Linear(channels, 3 * channels));
    proj_ = register_module("proj", nn::Linear(channels, channels));
  }

  // @param x [B, T, C] @return [B, T, C]
  Tensor forward(const Tensor& x) {
    const std::int64_t channels = x.size(2);
    const Tensor heads = qkv_->forward(x).view({x.size(0), x.size(1), 3, num_heads_, channels / num_heads_});
    const std::vector<Tensor> parts = heads.permute({2, 0, 3, 1, 4}).unbind(0);  // [B, h, T, d] each
    const Tensor mixed = nn::attend(parts[0], parts[1], parts[2]);
    return proj_->forward(mixed.transpose(1, 2).reshape({x.size(0), x.size(1), channels}));
  }

 private:
  std::int64_t num_heads_;
  nn::Linear qkv_ = nullptr, proj_ = nullptr;
};
TORCH_MODULE(Dinov2Attention);

// Pre-norm block x += ls1 ⊙ attn(norm1(x)), x += ls2 ⊙ mlp(norm2(x)); norms with parameters and eps 1e-6
// (docs/reference/flows.md, 5.3).
class Dinov2BlockImpl : public torch::nn::Module {
 public:
  explicit Dinov2BlockImpl(const Dinov2Options& options) {
    const std::int64_t channels = options.embed_dim;
    norm1_ = register_module("norm1", nn::AffineLayerNorm(channels, nn::kBlockNormEps));
    attention_ = register_module("attn", Dinov2Attention(channels, options.num_heads));
    ls1_ = register_module("ls1", nn::LayerScale(channels));
    norm2_ = register_module("norm2", nn::AffineLayerNorm(channels, nn::kBlockNormEps));
    mlp_ = register_module("mlp", Dinov2FeedForward(options));
    ls2_ = register_module("ls2", nn::LayerScale(channels));
  }

  Tensor forward(const Tensor& x) {
    const Tensor attended = x + ls1_->forward(attention_->forward(norm1_->forward(x)));
    return attended + ls2_->forward(mlp_->forward(norm2_->forward(attended)));
  }

 private:
  nn::AffineLayerNorm norm1_ = nullptr, norm2_ = nullptr;
  Dinov2Attention attention_ = nullptr;
  Dinov2FeedForward mlp_ = nullptr;
  nn::LayerScale ls1_ = nullptr, ls2_ = nullptr;
};
TORCH_MODULE(Dinov2Block);

using Names = std::pair<const char*, const char*>;  // transformers, hub

constexpr std::array<Names, 6> kOutside = {{{"embeddings.cls_token", "cls_token"},
                                            {"embeddings.mask_token", "mask_token"},
                                            {"embeddings.register_tokens", "register_tokens"},
                                            {"embeddings.position_embeddings", "pos_embed"},
                                            {"embeddings.patch_embeddings.projection.", "patch_embed.proj."},
                                            {"layernorm.", "norm."}}};

constexpr std::array<Names, 8> kInBlocks = {{{"norm1.", "norm1."},
                                             {"norm2.", "norm2."},
                                             {"attention.output.dense.", "attn.proj."},
                                             {"layer_scale1.lambda1", "ls1.gamma"},
                                             {"layer_scale2.lambda1", "ls2.gamma"},
                                             {"mlp.fc", "mlp.fc"},
                                             {"mlp.weights_in.", "mlp.w12."},
                                             {"mlp.weights_out.", "mlp.w3."}}};

constexpr std::array<const char*, 3> kProjections = {"query", "key", "value"};  // in the order of the rows of qkv

bool starts_with(const std::string& text, const std::string& prefix) {
  return text.compare(0, prefix.size(), prefix) == 0;
}

// Replaces the first prefix of the table that fits. @return whether one did
template <std::size_t N>
bool rename(std::string& key, const std::array<Names, N>& table) {
  for (const auto& [from, to] : table) {
    if (!starts_with(key, from)) continue;
    key = to + key.substr(std::string(from).size());
    return true;
  }
  return false;
}

// "encoder.layer.3.norm1.weight" → "blocks.3." and "norm1.weight".
bool split_block(const std::string& key, std::string& block, std::string& rest) {
  const std::string prefix = "encoder.layer.";
  if (!starts_with(key, prefix)) return false;
  const std::size_t dot = key.find('.', prefix.size());
  if (dot == std::string::npos) return false;
  block = "blocks." + key.substr(prefix.size(), dot + 1 - prefix.size());
  rest = key.substr(dot + 1);
  return true;
}

// One of the three projections of a block, under the key of the joined array.
struct Part {
  std::string joined;  // "blocks.3.attn.qkv.weight"
  std::size_t place;   // 0 query, 1 key, 2 value
};

bool is_projection(const std::string& block, const std::string& rest, Part& part) {
  for (std::size_t i = 0; i < kProjections.size(); ++i) {
    const std::string prefix = std::string("attention.attention.") + kProjections[i] + ".";
    if (!starts_with(rest, prefix)) continue;
    part = {block + "attn.qkv." + rest.substr(prefix.size()), i};
    return true;
  }
  return false;
}

using Triple = std::array<std::pair<std::string, io::NdArray>, 3>;  // under their own keys; empty key: absent

bool fit_together(const Triple& triple) {
  return std::all_of(triple.begin(), triple.end(), [&](const auto& part) {
    return !part.first.empty() && part.second.dtype == triple[0].second.dtype && !part.second.shape.empty() &&
           part.second.shape == triple[0].second.shape;
  });
}

io::NdArray joined(const Triple& triple) {
  io::NdArray all = triple[0].second;
  all.shape[0] *= 3;
  for (std::size_t i = 1; i < triple.size(); ++i) {
    const auto& bytes = triple[i].second.bytes;
    all.bytes.insert(all.bytes.end(), bytes.begin(), bytes.end());
  }
  return all;
}

}  // namespace

std::vector<std::string> Dinov2Options::names() {
  std::vector<std::string> all;
  for (const bool registers : {false, true}) {
    for (const Size& size : kSizes) all.push_back(name_of(size, registers));
  }
  return all;
}

std::string Dinov2Options::published_file_stem(const std::string& name) {
  const bool registers = name.size() > 4 && name.compare(name.size() - 4, 4, "_reg") == 0;
  return name + (registers ? "4" : "") + "_pretrain";
}

Dinov2Options Dinov2Options::named(const std::string& name) {
  for (const bool registers : {false, true}) {
    for (const Size& size : kSizes) {
      if (name_of(size, registers) != name) continue;
      Dinov2Options options;
      options.embed_dim = size.embed_dim;
      options.depth = size.depth;
      options.num_heads = size.num_heads;
      options.ffn_layer = size.ffn_layer;
      options.num_register_tokens = registers ? kRegisters : 0;
      options.interpolate_antialias = registers;
      options.interpolate_offset = registers ? 0.0 : 0.1;
      return options;
    }
  }
  const std::string nearest = nearest_word(name, names());
  throw InputError("", "",
                   "there is no DINOv2 model '" + name + "'; " +
                       (nearest.empty() ? "known are dinov2_vit{s,b,l,g}14 and the same with _reg"
                                        : "did you mean '" + nearest + "'?"));
}

void Dinov2Options::fields(ConfigFields& f) {
  f("img_size", img_size, {1, kMostDinoSide});
  f("patch_size", patch_size, {1, kMostDinoSide});
  f("embed_dim", embed_dim, {1, kMostDinoChannels});
  f("depth", depth, {0, kMostDinoBlocks});
  f("num_heads", num_heads, {1, kMostDinoChannels});
  f("mlp_ratio", mlp_ratio, {0.0, 64.0});
  f("ffn_layer", ffn_layer, {"mlp", "swiglu", "swiglufused"});
  f("num_register_tokens", num_register_tokens, {0, kMostDinoChannels});
  f("interpolate_antialias", interpolate_antialias);
  f("interpolate_offset", interpolate_offset, {0.0, 1.0});
  if (f.writes()) return;
  double init_values = 1.0;
  f("init_values", init_values);
  std::int64_t block_chunks = 0;
  f("block_chunks", block_chunks);
  if (block_chunks != 0) throw f.not_supported("block_chunks", "blocks in chunks, which no published weights use");
}

void Dinov2Options::validate(const std::string& file, const std::string& pointer) const {
  const OptionCheck check{file, pointer};
  check(patch_size > 0 && img_size >= patch_size, "img_size",
        std::to_string(img_size) + " pixels hold no patch of " + std::to_string(patch_size));
  check.heads("num_heads", num_heads, embed_dim);
  check(ffn_hidden() >= 1, "mlp_ratio", "leaves no hidden channel");
}

std::int64_t Dinov2Options::ffn_hidden() const {
  const auto hidden = static_cast<std::int64_t>(static_cast<double>(embed_dim) * mlp_ratio);
  if (!swiglu()) return hidden;
  return (hidden * 2 / 3 + 7) / 8 * 8;
}

Tensor interpolate_positions(const Tensor& pos_embed, std::int64_t rows, std::int64_t columns, bool antialias,
                             double offset) {
  const std::int64_t patches = pos_embed.size(1) - 1, channels = pos_embed.size(2);
  const auto side = static_cast<std::int64_t>(std::llround(std::sqrt(static_cast<double>(patches))));
  TORCH_CHECK(rows >= 1 && columns >= 1 && side * side == patches, "position embeddings of ", patches,
              " patches for a picture of ", rows, " x ", columns);
  if (rows == side && columns == side) return pos_embed;

  const Tensor wide = pos_embed.to(torch::kFloat32);
  const Tensor grid = wide.slice(1, 1).reshape({1, side, side, channels}).permute({0, 3, 1, 2}).contiguous();
  const Tensor resampled = resample(grid, rows, columns, antialias, offset).permute({0, 2, 3, 1});
  const Tensor all = torch::cat({wide.slice(1, 0, 1), resampled.reshape({1, rows * columns, channels})}, 1);
  return all.to(nn::dtype_of(pos_embed));
}

Dinov2FeedForwardImpl::Dinov2FeedForwardImpl(const Dinov2Options& options) : swiglu_(options.swiglu()) {
  const std::int64_t channels = options.embed_dim, hidden = options.ffn_hidden();
  first_ = register_module(swiglu_ ? "w12" : "fc1", nn::Linear(channels, swiglu_ ? 2 * hidden : hidden));
  second_ = register_module(swiglu_ ? "w3" : "fc2", nn::Linear(hidden, channels));
}

Tensor Dinov2FeedForwardImpl::forward(const Tensor& x) {
  const Tensor inner = first_->forward(x);
  if (!swiglu_) return second_->forward(torch::gelu(inner));
  const std::vector<Tensor> halves = inner.chunk(2, -1);
  return second_->forward(torch::silu(halves[0]) * halves[1]);
}

Dinov2Impl::Dinov2Impl(const Dinov2Options& options) : options_(options) {
  options_.validate();
  const std::int64_t channels = options_.embed_dim, side = options_.patches_per_side();
  cls_token_ = register_parameter("cls_token", torch::empty({1, 1, channels}));
  pos_embed_ = register_parameter("pos_embed", torch::empty({1, 1 + side * side, channels}));
  if (options_.num_register_tokens > 0) {
    register_tokens_ = register_parameter("register_tokens", torch::empty({1, options_.num_register_tokens, channels}));
  }
  mask_token_ = register_parameter("mask_token", torch::empty({1, channels}));
  const auto patch_embed = register_module("patch_embed", std::make_shared<torch::nn::Module>());
  const auto projection = patch_embed->register_module("proj", std::make_shared<torch::nn::Module>());
  const std::int64_t patch = options_.patch_size;
  patch_weight_ = projection->register_parameter("weight", torch::empty({channels, 3, patch, patch}));
  patch_bias_ = projection->register_parameter("bias", torch::empty({channels}));
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
  const Tensor patches = torch::conv2d(images, patch_weight_, patch_bias_, /*stride=*/patch).flatten(2).transpose(1, 2);
  Tensor x = torch::cat({cls_token_.expand({batch, -1, -1}), patches}, 1);
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
  const auto per_channel = [&](const std::vector<double>& values) {
    const Tensor host = torch::tensor(values, torch::TensorOptions(images.scalar_type()));
    return nn::to_device(host, images.device()).view({3, 1, 1});
  };
  return (images - per_channel({0.485, 0.456, 0.406})) / per_channel({0.229, 0.224, 0.225});
}

// NOLINTNEXTLINE(performance-unnecessary-value-param): arrays are moved out of it
io::NamedArrays to_hub_keys(io::NamedArrays arrays) {
  io::NamedArrays renamed;
  std::map<std::string, Triple> projections;
  for (auto& [key, array] : arrays) {
    std::string block, rest;
    Part part;
    if (!split_block(key, block, rest)) {
      rename(key, kOutside);
    } else if (is_projection(block, rest, part)) {
      projections[part.joined][part.place] = {key, std::move(array)};
      continue;
    } else if (rename(rest, kInBlocks)) {
      key = block + rest;
    }
    renamed.emplace_back(std::move(key), std::move(array));
  }
  for (auto& [key, triple] : projections) {
    if (fit_together(triple)) {
      renamed.emplace_back(key, joined(triple));
      continue;
    }
    for (auto& [own, array] : triple) {
      if (!own.empty()) renamed.emplace_back(own, std::move(array));
    }
  }
  return renamed;
}

void load_dinov2_weights(Dinov2& model, const std::filesystem::path& file) {
  io::NamedArrays arrays = to_hub_keys(io::read_state_dict(file));
  nn::check_weight_values(arrays, file.string());
  nn::load_state_dict(*model, std::move(arrays), nn::LoadMode::kStrict, file.string());
  for (const Tensor& parameter : model->parameters()) parameter.requires_grad_(false);
  model->eval();
}

}  // namespace anigen::vision
