#pragma once
#include <functional>
#include <string>
#include <vector>

#include "anigen/nn/blocks.h"
#include "anigen/nn/linear.h"
#include "anigen/nn/torch.h"
#include "anigen/nn/volumes.h"
#include "anigen/sparse_structure/options.h"

namespace anigen::sparse_structure {

/// x' = skip(x) + conv2(silu(norm2(conv1(silu(norm1(x)))))): 3³ convolutions, channel layer norms, skip the identity or
/// a 1³ convolution where the width changes (docs/reference/autoencoders.md, 3.1). Keys `norm{1,2}.*`, `conv{1,2}.*`,
/// `skip_connection.*`. The model's initialisation must call initialize(), which makes a fresh block the identity (of
/// its skip).
class VolumeResBlockImpl : public torch::nn::Module {
 public:
  VolumeResBlockImpl(std::int64_t in_channels, std::int64_t out_channels);
  torch::Tensor forward(const torch::Tensor& x);  ///< @param x [B, C, X, Y, Z] @return [B, C', X, Y, Z]
  void initialize();                              ///< conv2 to zero

 private:
  nn::VolumeNorm norm1_ = nullptr, norm2_ = nullptr;
  nn::Conv3d conv1_ = nullptr, conv2_ = nullptr, skip_connection_ = nullptr;
};
TORCH_MODULE(VolumeResBlock);

/// norm, SiLU, 3³ convolution: the `out_layer` of a stream, contiguous. Keys `0.*` (norm), `2.*` (convolution).
class VolumeHeadImpl : public torch::nn::Module {
 public:
  VolumeHeadImpl(std::int64_t in_channels, std::int64_t out_channels, nn::VolumeNormImpl::Kind norm);
  torch::Tensor forward(const torch::Tensor& x);

 private:
  nn::VolumeNorm norm_ = nullptr;
  nn::Conv3d conv_ = nullptr;
};
TORCH_MODULE(VolumeHead);

/// A row of VolumeResBlocks and resamplers, or of nothing; keys `0.*`, `1.*`, … One dtype for all convolutions inside,
/// which forward() casts to.
class VolumeTorsoImpl : public torch::nn::Module {
 public:
  void add_res_blocks(std::int64_t count, std::int64_t channels);
  /// @param up doubles the resolution, else halves it (docs/reference/autoencoders.md, 3.1 and Down)
  void add_resampler(std::int64_t in_channels, std::int64_t out_channels, bool up);

  /// @param x [B, C, X, Y, Z] of any floating dtype @return in the dtype of the convolutions; x itself when empty
  torch::Tensor forward(const torch::Tensor& x);

 private:
  template <typename Holder>
  void add(Holder layer);
  std::vector<std::function<torch::Tensor(const torch::Tensor&)>> layers_;
  torch::Tensor first_kernel_;  // of the first convolution, to know their dtype
};
TORCH_MODULE(VolumeTorso);

/// PyTorch's initial values for all convolutions below `module`, 1/0 for norms, then VolumeResBlock::initialize
/// (docs/reference/autoencoders.md, 1.6).
void initialize_volume_layers(torch::nn::Module& module);

/// Heads of the attention of the token bottlenecks; the first block of a decoder, which takes the latent in, has fewer.
inline constexpr std::int64_t kGlobalTokenHeads = 16, kGlobalTokenFirstHeads = 4;
/// Edge of the occupancy grid for which a bottleneck is built: its grid positions are part of the model.
inline constexpr std::int64_t kGlobalTokenResolution = 64;

/// Sizes of a token bottleneck between N = r³ cells of width C and T tokens of the latent's width.
struct GlobalTokenSizes {
  std::int64_t tokens = 0, channels = 0, latent = 0;  ///< T, C, width of a token
  std::int64_t edge = 0;                              ///< r
};

/// Layers of the bottlenecks of `encode_global`. Not modules of their own, since the published keys lie beside those of
/// the model, with which the constructors register them (`_ss` behind the names of the shape stream). Compute in fp32,
/// where the published ones attend in fp16: no conversion reaches them.
class GlobalTokens {
 public:
  bool present() const { return sizes_.tokens > 0; }
  void initialize();  ///< the learned start to zero; the linear layers are the model's to initialise

 protected:
  GlobalTokens() = default;
  explicit GlobalTokens(const GlobalTokenSizes& sizes) : sizes_(sizes) {}
  void register_tokens(torch::nn::Module& model, bool skeleton);  ///< positions of the tokens
  void register_grid(torch::nn::Module& model, bool skeleton);    ///< positions of the cells

  GlobalTokenSizes sizes_;
  torch::Tensor start_, tokens_pos_emb_, grid_pos_emb_;
  nn::Linear token_proj_ = nullptr;
  nn::DenseCrossBlock cross_ = nullptr;
  std::vector<nn::DenseBlock> blocks_;
};

/// Bottleneck in place of an encoder stream's out_layer: T learned tokens look at all cells
/// (docs/reference/autoencoders.md, 3.3). Keys `init_tokens`, `tokens_pos_emb`, `grid_pos_emb`, `token_proj.*` and
/// `out_layer{,_skl}.0` to `.5`.
class GlobalTokenEncoder : public GlobalTokens {
 public:
  GlobalTokenEncoder() = default;
  GlobalTokenEncoder(torch::nn::Module& model, bool skeleton, const GlobalTokenSizes& sizes);

  /// @param cells [B, C, r, r, r] @return [B, T, latent] @throws InputError for another grid
  torch::Tensor forward(const torch::Tensor& cells);

 private:
  nn::FeedForward head_ = nullptr;
};

/// The way back, in place of a decoder stream's input_layer: blocks over the tokens, then learned grid cells look at
/// them. Keys `init_grids`, `grid_pos_emb`, `tokens_pos_emb`, `token_proj.*` and `input_layer{,_skl}.0` to `.4`.
class GlobalTokenDecoder : public GlobalTokens {
 public:
  GlobalTokenDecoder() = default;
  GlobalTokenDecoder(torch::nn::Module& model, bool skeleton, const GlobalTokenSizes& sizes);

  /// @param tokens [B, T, latent] @return [B, C, r, r, r] @throws InputError for another shape
  torch::Tensor forward(const torch::Tensor& tokens);
};

// Members that encoder and decoder of the sparse structure share beside their layers.

/// Axis of the channels: 1 of volumes [B, C, X, Y, Z], the last of tokens [B, T, C].
std::int64_t channel_axis(const torch::Tensor& latents);

/// Norm 1 over the channels at each cell or token: x / max(‖x‖, 1e-12). @param order 2, or 1 for the ℓ1 norm
torch::Tensor unit_latents(const torch::Tensor& latents, double order = 2.0);

/// "layer" or "group".
nn::VolumeNormImpl::Kind norm_kind(const std::string& norm_type);

/// Sizes of a stream's token bottleneck. @param channels width of the cells @param latent width of the tokens
GlobalTokenSizes token_sizes(const SparseStructureCoderOptions& options, bool skeleton, std::int64_t channels,
                             std::int64_t latent);

}  // namespace anigen::sparse_structure
