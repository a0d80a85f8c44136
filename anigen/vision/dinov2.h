#pragma once
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "anigen/core/config_fields.h"
#include "anigen/io/arrays/ndarray.h"
#include "anigen/nn/linear.h"
#include "anigen/nn/norms.h"
#include "anigen/nn/torch.h"

namespace anigen::vision {

/// Size and form of a DINOv2 vision transformer (Oquab et al. 2023; registers: Darcet et al. 2023), under the argument
/// names of the published hub models (docs/reference/flows.md, 5.3).
struct Dinov2Options : JsonOptions<Dinov2Options> {
  std::int64_t img_size = 518;   ///< pixels on a side for which pos_embed was made
  std::int64_t patch_size = 14;  ///< pixels
  std::int64_t embed_dim = 1024;
  std::int64_t depth = 24;
  std::int64_t num_heads = 16;
  double mlp_ratio = 4.0;
  /// "mlp": Linear · exact GELU · Linear. "swiglufused" (also spelt "swiglu"): silu(a) ⊙ b, then Linear, with the
  /// hidden width reduced to two thirds, rounded up to a multiple of 8.
  std::string ffn_layer = "mlp";
  std::int64_t num_register_tokens = 0;
  /// Resampling of pos_embed to another number of patches: see interpolate_positions.
  bool interpolate_antialias = false;
  double interpolate_offset = 0.1;

  /// The published models by name: dinov2_vits14, dinov2_vitb14, dinov2_vitl14, dinov2_vitg14 and the same with _reg.
  /// @throws InputError naming the nearest one
  static Dinov2Options named(const std::string& name);
  static std::vector<std::string> names();
  /// Name of the published file of a model, without its extension: dinov2_vitl14_reg comes as
  /// dinov2_vitl14_reg4_pretrain.pth.
  static std::string published_file_stem(const std::string& name);

  /// Also `init_values` (of no use once weights are loaded) and `block_chunks` (0 only, the form of the published
  /// weights). @throws NotSupportedError for block_chunks
  void fields(ConfigFields& f);
  void validate(const std::string& file = "", const std::string& pointer = "") const;

  std::int64_t patches_per_side() const { return img_size / patch_size; }  ///< of pos_embed
  std::int64_t ffn_hidden() const;                                         ///< width between the two linear maps
  bool swiglu() const { return ffn_layer != "mlp"; }
};

using torch::Tensor;

/// DINOv2's position embedding for a picture of rows × columns patches. At its own (square) size the parameter is
/// returned untouched. Otherwise the M × M grid of patch embeddings is resampled bicubically (align_corners false), and
/// the class token's entry kept. The two published families differ (README of the parity fixtures, "DINOv2"):
/// - models with registers: antialiased, offset 0, and the kernel scales by M / rows and M / columns;
/// - models without: not antialiased, offset 0.1, and the kernel scales by exactly M / (rows + 0.1), so that it samples
///   slightly other places than a call by size would.
/// @param pos_embed [1, 1 + M·M, C], class token first @param rows,columns at least 1
/// @return [1, 1 + rows·columns, C], patches row by row, dtype of pos_embed
Tensor interpolate_positions(const Tensor& pos_embed, std::int64_t rows, std::int64_t columns, bool antialias,
                             double offset);

/// The feed-forward part: keys `fc1`, `fc2` with the exact (erf) GELU, or for SwiGLU `w12` (gate rows first) and `w3`.
class Dinov2FeedForwardImpl : public torch::nn::Module {
 public:
  explicit Dinov2FeedForwardImpl(const Dinov2Options& options);
  /// @param x [..., C] @return [..., C]
  Tensor forward(const Tensor& x);

 private:
  bool swiglu_;
  nn::Linear first_ = nullptr, second_ = nullptr;
};
TORCH_MODULE(Dinov2FeedForward);

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

/// DINOv2 (docs/reference/flows.md, 5.3): patches by a strided convolution, class token, position embedding, registers
/// after the class token and without a position, blocks, final norm. Keys as published: `cls_token`, `pos_embed`,
/// `register_tokens` (models with registers), `mask_token` (loaded, never used here), `patch_embed.proj.*`,
/// `blocks.<i>.*`, `norm.*`. The constructor reserves memory and writes nothing: load every tensor before use
/// (vision/dinov2.h).
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
  Tensor patch_weight_, patch_bias_;  // [C, 3, patch, patch], [C]: a convolution whose stride is its width
  torch::nn::ModuleList blocks_ = nullptr;
  nn::AffineLayerNorm norm_ = nullptr;
};
TORCH_MODULE(Dinov2);

/// Takes off ImageNet's mean (0.485, 0.456, 0.406) and divides by its deviation (0.229, 0.224, 0.225).
/// @param images [..., 3, H, W], RGB in [0, 1] @return the same shape
Tensor imagenet_normalized(const Tensor& images);

/// DINOv2's weights are published twice: as `.pth` under the hub's own keys, which the model here uses, and as
/// `.safetensors` of the Hugging Face repositories under the keys of its `transformers` library ("encoder.layer.3.…"),
/// where queries, keys and values are apart. Brings the second form to the first; arrays without any key of the second
/// form come back as they are, and so do keys that belong to neither.
io::NamedArrays to_hub_keys(io::NamedArrays arrays);

/// Fills a model from a file of published weights: `.pth` / `.pt` of torch.save, or `.safetensors`, with the hub's keys
/// or those of the `transformers` library (vision/dinov2.h). Afterwards no parameter asks for gradients and the
/// model is in evaluation mode.
/// @throws InputError naming the file and, where it applies, the key: a damaged file, missing or unexpected keys,
///   another size of model (both shapes), a value that is not finite, whole numbers where floats belong
void load_dinov2_weights(Dinov2& model, const std::filesystem::path& file);

}  // namespace anigen::vision
