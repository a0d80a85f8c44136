#include "anigen/sparse_structure/layers.h"

#include "anigen/core/error.h"
#include "anigen/nn/embeddings.h"
#include "anigen/nn/init.h"

namespace anigen::sparse_structure {

using torch::Tensor;

VolumeResBlockImpl::VolumeResBlockImpl(std::int64_t in_channels, std::int64_t out_channels) {
  norm1_ = register_module("norm1", nn::VolumeNorm(in_channels));
  norm2_ = register_module("norm2", nn::VolumeNorm(out_channels));
  conv1_ = register_module("conv1", nn::Conv3d(in_channels, out_channels, 3, 1, 1));
  conv2_ = register_module("conv2", nn::Conv3d(out_channels, out_channels, 3, 1, 1));
  if (in_channels != out_channels)
    skip_connection_ = register_module("skip_connection", nn::Conv3d(in_channels, out_channels, 1));
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

namespace {

// Change of resolution by 2: a 2³ convolution of stride 2 (Down), or a 3³ one to eight times the width, then pixel
// shuffle (Up). Key `conv.*`.
class VolumeResamplerImpl : public torch::nn::Module {
 public:
  VolumeResamplerImpl(std::int64_t in, std::int64_t out, bool up) : up_(up) {
    conv_ = register_module("conv", up ? nn::Conv3d(in, 8 * out, 3, 1, 1) : nn::Conv3d(in, out, 2, 2));
  }
  Tensor forward(const Tensor& x) { return up_ ? nn::pixel_shuffle_3d(conv_->forward(x), 2) : conv_->forward(x); }

 private:
  bool up_;
  nn::Conv3d conv_ = nullptr;
};
TORCH_MODULE(VolumeResampler);

constexpr int kTokenBlocks = 4;

nn::DenseBlockOptions token_block(std::int64_t channels) {
  nn::DenseBlockOptions options;
  options.channels = channels;
  options.num_heads = kGlobalTokenHeads;
  options.qkv_bias = false;
  return options;
}

nn::DenseCrossBlock token_cross_block(std::int64_t channels, std::int64_t context_channels) {
  nn::DenseBlockOptions options = token_block(channels);
  options.context_channels = context_channels;
  return nn::DenseCrossBlock(options);
}

// Keys of the shape stream end in _ss, those of the skeleton in nothing: the other way round than all others.
std::string token_key(const char* name, bool skeleton) { return std::string(name) + (skeleton ? "" : "_ss"); }

// Rows [B, N, A] with their positions [N, C] behind: [B, N, A + C].
Tensor with_positions(const Tensor& rows, const Tensor& positions) {
  const Tensor repeated = positions.to(rows.scalar_type()).unsqueeze(0).expand({rows.size(0), -1, -1});
  return torch::cat({rows, repeated}, 2);
}

}  // namespace

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

void VolumeTorsoImpl::add_resampler(std::int64_t in_channels, std::int64_t out_channels, bool up) {
  add(VolumeResampler(in_channels, out_channels, up));
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

void GlobalTokens::initialize() {
  if (present()) torch::nn::init::zeros_(start_);
}

void GlobalTokens::register_tokens(torch::nn::Module& model, bool skeleton) {
  const Tensor places = torch::arange(sizes_.tokens).unsqueeze(1);
  tokens_pos_emb_ = model.register_buffer(token_key("tokens_pos_emb", skeleton),
                                          nn::absolute_position_embedding(places, sizes_.channels));
}

void GlobalTokens::register_grid(torch::nn::Module& model, bool skeleton) {
  const Tensor places = nn::grid_coordinates(sizes_.edge);
  grid_pos_emb_ = model.register_buffer(token_key("grid_pos_emb", skeleton),
                                        nn::absolute_position_embedding(places, sizes_.channels));
}

// Both register in the order of published state dicts.
GlobalTokenEncoder::GlobalTokenEncoder(torch::nn::Module& model, bool skeleton, const GlobalTokenSizes& sizes)
    : GlobalTokens(sizes) {
  const std::int64_t c = sizes.channels;
  start_ = model.register_parameter(token_key("init_tokens", skeleton), torch::empty({1, sizes.tokens, c}));
  register_tokens(model, skeleton);
  register_grid(model, skeleton);
  token_proj_ = model.register_module(token_key("token_proj", skeleton), nn::Linear(2 * c, c));
  cross_ = token_cross_block(c, 2 * c);
  for (int i = 0; i < kTokenBlocks; ++i) blocks_.emplace_back(token_block(c));
  head_ = nn::FeedForward(c, sizes.latent);
  torch::nn::ModuleList layers(cross_);
  layers->extend(*nn::module_list(blocks_));
  layers->push_back(head_);
  model.register_module(skeleton ? "out_layer_skl" : "out_layer", layers);
}

Tensor GlobalTokenEncoder::forward(const Tensor& cells) {
  for (std::int64_t axis = 2; axis < 5; ++axis) {
    if (cells.size(axis) == sizes_.edge) continue;
    throw InputError("", "",
                     "with encode_global the occupancy grid must have edge " + std::to_string(kGlobalTokenResolution));
  }
  const Tensor context = with_positions(cells.flatten(2).transpose(1, 2), grid_pos_emb_);
  const Tensor start = start_.expand({cells.size(0), -1, -1});
  Tensor h = cross_->forward(token_proj_->forward(with_positions(start, tokens_pos_emb_)), context);
  for (nn::DenseBlock& block : blocks_) h = block->forward(h);
  return head_->forward(h);
}

GlobalTokenDecoder::GlobalTokenDecoder(torch::nn::Module& model, bool skeleton, const GlobalTokenSizes& sizes)
    : GlobalTokens(sizes) {
  const std::int64_t c = sizes.channels, cells = sizes.edge * sizes.edge * sizes.edge;
  start_ = model.register_parameter(token_key("init_grids", skeleton), torch::empty({1, cells, c}));
  register_grid(model, skeleton);
  register_tokens(model, skeleton);
  token_proj_ = model.register_module(token_key("token_proj", skeleton), nn::Linear(2 * c, c));
  nn::DenseBlockOptions first = token_block(c + sizes.latent);
  first.out_channels = c;
  first.num_heads = kGlobalTokenFirstHeads;
  for (int i = 0; i < kTokenBlocks; ++i) blocks_.emplace_back(i == 0 ? first : token_block(c));
  cross_ = token_cross_block(c, c);
  torch::nn::ModuleList layers = nn::module_list(blocks_);
  layers->push_back(cross_);
  model.register_module(skeleton ? "input_layer_skl" : "input_layer", layers);
}

Tensor GlobalTokenDecoder::forward(const Tensor& tokens) {
  if (tokens.size(1) != sizes_.tokens) {
    throw InputError("", "",
                     "the decoder was built for " + std::to_string(sizes_.tokens) + " tokens, found " +
                         std::to_string(tokens.size(1)));
  }
  Tensor h = with_positions(tokens, tokens_pos_emb_);
  for (nn::DenseBlock& block : blocks_) h = block->forward(h);
  const Tensor start = start_.expand({tokens.size(0), -1, -1});
  const Tensor cells = cross_->forward(token_proj_->forward(with_positions(start, grid_pos_emb_)), h);
  return cells.transpose(1, 2).reshape({tokens.size(0), sizes_.channels, sizes_.edge, sizes_.edge, sizes_.edge});
}

std::int64_t channel_axis(const Tensor& latents) { return latents.dim() == 5 ? 1 : latents.dim() - 1; }

Tensor unit_latents(const Tensor& latents, double order) {
  namespace F = torch::nn::functional;
  return F::normalize(latents, F::NormalizeFuncOptions().p(order).dim(channel_axis(latents)).eps(1e-12));
}

nn::VolumeNormImpl::Kind norm_kind(const std::string& norm_type) {
  return norm_type == "group" ? nn::VolumeNormImpl::Kind::kGroup : nn::VolumeNormImpl::Kind::kLayer;
}

GlobalTokenSizes token_sizes(const SparseStructureCoderOptions& options, bool skeleton, std::int64_t channels,
                             std::int64_t latent) {
  GlobalTokenSizes sizes;
  sizes.tokens = skeleton ? options.global_token_num_skl : options.global_token_num;
  sizes.channels = channels;
  sizes.latent = latent;
  sizes.edge = kGlobalTokenResolution / options.downsampling();
  return sizes;
}

}  // namespace anigen::sparse_structure
