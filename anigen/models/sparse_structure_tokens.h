#pragma once
#include <vector>

#include "anigen/nn/dense_block.h"
#include "anigen/nn/linear.h"

namespace anigen::models {

/// Heads of the attention of the token bottlenecks; the first block of a decoder, which takes the latent in, has fewer.
inline constexpr std::int64_t kGlobalTokenHeads = 16, kGlobalTokenFirstHeads = 4;
/// Edge of the occupancy grid for which a bottleneck is built: its grid positions are part of the model.
inline constexpr std::int64_t kGlobalTokenResolution = 64;

/// Sizes of a token bottleneck between N = r³ cells of width C and T tokens of the latent's width.
struct GlobalTokenSizes {
  std::int64_t tokens = 0, channels = 0, latent = 0;  ///< T, C, width of a token
  std::int64_t edge = 0;                              ///< r
};

/// Bottleneck of `encode_global` in place of an encoder stream's out_layer: T learned tokens look at all cells
/// (reference autoencoders.md, 2.5). Computes in fp32, where the published one attends in fp16: no conversion reaches
/// it. Not a module of its own, since the published keys lie beside those of the model: `init_tokens`,
/// `tokens_pos_emb`, `grid_pos_emb`, `token_proj.*` (with `_ss` for the shape stream) and `out_layer{,_skl}.0` to `.5`,
/// which the constructor registers with it.
class GlobalTokenEncoder {
 public:
  GlobalTokenEncoder() = default;
  GlobalTokenEncoder(torch::nn::Module& model, bool skeleton, const GlobalTokenSizes& sizes);
  bool present() const { return sizes_.tokens > 0; }

  /// @param cells [B, C, r, r, r] @return [B, T, latent] @throws InputError for another grid
  torch::Tensor forward(const torch::Tensor& cells);
  void initialize();  ///< tokens to zero; the linear layers are the model's to initialise

 private:
  GlobalTokenSizes sizes_;
  torch::Tensor init_tokens_, tokens_pos_emb_, grid_pos_emb_;
  nn::Linear token_proj_ = nullptr;
  nn::DenseCrossBlock cross_ = nullptr;
  std::vector<nn::DenseBlock> blocks_;
  nn::FeedForward head_ = nullptr;
};

/// The way back, in place of a decoder stream's input_layer: blocks over the tokens, then learned grid cells look at
/// them. Keys `init_grids`, `grid_pos_emb`, `tokens_pos_emb`, `token_proj.*` (with `_ss` for the shape stream) and
/// `input_layer{,_skl}.0` to `.4`.
class GlobalTokenDecoder {
 public:
  GlobalTokenDecoder() = default;
  GlobalTokenDecoder(torch::nn::Module& model, bool skeleton, const GlobalTokenSizes& sizes);
  bool present() const { return sizes_.tokens > 0; }

  /// @param tokens [B, T, latent] @return [B, C, r, r, r] @throws InputError for another shape
  torch::Tensor forward(const torch::Tensor& tokens);
  void initialize();

 private:
  GlobalTokenSizes sizes_;
  torch::Tensor init_grids_, tokens_pos_emb_, grid_pos_emb_;
  nn::Linear token_proj_ = nullptr;
  std::vector<nn::DenseBlock> blocks_;
  nn::DenseCrossBlock cross_ = nullptr;
};

}  // namespace anigen::models
