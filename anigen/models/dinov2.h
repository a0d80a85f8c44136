#pragma once
#include "anigen/models/dinov2_block.h"
#include "anigen/models/dinov2_options.h"
#include "anigen/models/dinov2_patch_embed.h"

namespace anigen::models {

/// The tokens of a batch of pictures: class, registers, patches (row by row, from the top left).
struct Dinov2Tokens {
  Tensor x_prenorm;  ///< [B, 1 + R + P, C], before the final norm: what the published system uses
  Tensor x_norm;     ///< the same after it
  std::int64_t registers = 0;
  std::int64_t rows = 0, columns = 0;  ///< of patches, P = rows · columns

  Tensor norm_class() const { return x_norm.select(1, 0); }                     ///< [B, C]
  Tensor norm_registers() const { return x_norm.slice(1, 1, 1 + registers); }   ///< [B, R, C]
  Tensor norm_patches() const { return x_norm.slice(1, 1 + registers); }        ///< [B, P, C]
  Tensor prenorm_patches() const { return x_prenorm.slice(1, 1 + registers); }  ///< [B, P, C]
};

/// DINOv2 (reference flows-and-pipeline.md, 5.3): patches by a strided convolution, class token, position embedding,
/// registers after the class token and without a position, blocks, final norm. Keys as published: `cls_token`,
/// `pos_embed`, `register_tokens` (models with registers), `mask_token` (loaded, never used here),
/// `patch_embed.proj.*`, `blocks.<i>.*`, `norm.*`. The constructor reserves memory and writes nothing: load every
/// tensor before use (models/dinov2_weights.h).
class Dinov2Impl : public torch::nn::Module {
 public:
  explicit Dinov2Impl(const Dinov2Options& options);

  /// @param images [B, 3, H, W] without ImageNet's mean and deviation (imagenet_normalized); H and W multiples of
  ///   patch_size
  Dinov2Tokens forward(const Tensor& images);
  /// The tokens after the first `blocks` blocks, [B, 1 + R + P, C]; all of them give x_prenorm.
  Tensor tokens_after(const Tensor& images, std::int64_t blocks);
  /// The position embedding for a picture of rows × columns patches, [1, 1 + rows·columns, C].
  Tensor positions(std::int64_t rows, std::int64_t columns) const;

  const Dinov2Options& options() const { return options_; }

 private:
  Dinov2Options options_;
  Tensor cls_token_, pos_embed_, register_tokens_, mask_token_;
  PatchEmbed patch_embed_ = nullptr;
  torch::nn::ModuleList blocks_ = nullptr;
  nn::AffineLayerNorm norm_ = nullptr;
};
TORCH_MODULE(Dinov2);

/// Takes off ImageNet's mean (0.485, 0.456, 0.406) and divides by its deviation (0.229, 0.224, 0.225).
/// @param images [..., 3, H, W], RGB in [0, 1] @return the same shape
Tensor imagenet_normalized(const Tensor& images);

}  // namespace anigen::models
