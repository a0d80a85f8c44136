#pragma once
#include <string>

#include "anigen/core/config_fields.h"
#include "anigen/nn/blocks.h"
#include "anigen/nn/init.h"
#include "anigen/nn/torch.h"
#include "anigen/vision/picture_estimator.h"

namespace anigen::vision {

using torch::Tensor;

/// Pictures to tokens by halving: 3 × 3 convolutions of stride 2, each but the last followed by a group norm without
/// parameters and GELU. Knows edges before anything is learned, which a transformer over raw patches has to find out
/// (Xiao et al. 2021, "Early Convolutions Help Transformers See Better"). Keys `layers.<i>.weight` and `.bias`.
class ConvolutionStemImpl : public torch::nn::Module {
 public:
  /// @param width channels of the tokens @param patch_size pixels that become one token, a power of two above 1
  /// @param in_channels of pictures
  ConvolutionStemImpl(std::int64_t width, std::int64_t patch_size, std::int64_t in_channels = 3);

  /// @param images [B, in_channels, S, S], S a multiple of patch_size
  /// @param levels gets the maps after every layer but the last, fine to coarse, when not null
  /// @return [B, (S / patch_size)², width], row by row
  Tensor forward(const Tensor& images, std::vector<Tensor>* levels = nullptr);
  /// Channels of those maps.
  std::vector<std::int64_t> level_channels() const;

 private:
  std::vector<torch::nn::Conv2d> layers_;
};
TORCH_MODULE(ConvolutionStem);

/// Arguments of a small image encoder of ours, for conditions where the published system uses DINOv2.
struct PatchImageEncoderOptions : JsonOptions<PatchImageEncoderOptions> {
  std::int64_t image_size = 112;  ///< pixels on a side
  std::int64_t patch_size = 14;   ///< divides image_size; 112 / 14 gives 8 x 8 tokens
  std::int64_t width = 192;       ///< channels of the blocks
  std::int64_t num_blocks = 3;
  std::int64_t num_heads = 4;  ///< divides width
  double mlp_ratio = 4.0;
  bool convolutions = false;  ///< `stem`: "linear", a patch as it is, or "convolutions" (vision/patch_encoder.h), for
                              ///< which patch_size is a power of two
  std::string estimator;      ///< run of a picture estimator (vision/picture_estimator.h), whose normals and
                              ///< coordinates the stem sees beside the colours; empty: none
  std::int64_t lift = 0;      ///< cells on a side of a grid in the object's frame, each one more token; 0: none. Needs
                              ///< estimator and stem "convolutions"
  std::string flow;           ///< run of another flow, whose image encoder's tokens follow; empty: none

  void fields(ConfigFields& f);  ///< also `name`, always "patch"
  void validate(const std::string& file = "", const std::string& pointer = "") const;
  std::int64_t patches() const { return (image_size / patch_size) * (image_size / patch_size); }
  /// Of patches and cells.
  std::int64_t tokens() const { return patches() + lift * lift * lift; }
};

/// A condition picture as tokens, learned together with the model that is conditioned: patches (a convolution whose
/// stride is its width, or several that halve), absolute position embedding of row and column, pre-norm transformer
/// blocks (nn::TransformerBlock), a linear map to the condition's width. Tokens leave through a layer norm without
/// parameters, as DINOv2's do before they become a condition (docs/reference/flows.md, 5.3), so that zeros, the
/// condition of no picture, are unlike those of any picture. Always fp32.
///
/// With `lift` more tokens follow, one for each cell of a grid in [-0.5, 0.5]³ of the object's frame, x slowest: maps
/// of the stem and the tokens, sampled where the estimated camera sees the middle of the cell (pixel-aligned features,
/// Saito et al. 2019, "PIFu"), how near it lies, and the place of the cell. Cross attention can so look up what is seen
/// at a place, without having to find the place in the picture.
///
/// With `flow` the tokens of another flow's image encoder come last, through a linear map: a flow that is dear to train
/// learns from few images, and sees by what a cheap one has learned from many.
class PatchImageEncoderImpl : public torch::nn::Module {
 public:
  /// @param flow_channels of the tokens of the other flow's encoder; only with `flow`
  PatchImageEncoderImpl(const PatchImageEncoderOptions& options, std::int64_t cond_channels,
                        nn::Init init = nn::Init::kPublished, std::int64_t flow_channels = 0);

  /// @param images [B, 3, S, S] fp32 in [0, 1], S = image_size @param estimate of these pictures; only with `estimator`
  /// @param flow_tokens [B, M, flow_channels] of these pictures; only with `flow`
  /// @return [B, tokens + M, cond_channels], patches row by row, then cells, then the M
  /// @throws InputError on another shape
  Tensor forward(const Tensor& images, const PictureEstimate& estimate = {}, const Tensor& flow_tokens = {});

  const PatchImageEncoderOptions& options() const { return options_; }

 private:
  PatchImageEncoderOptions options_;
  Tensor embed_patches(const Tensor& images, std::vector<Tensor>& levels);
  Tensor lifted(const Tensor& tokens, const std::vector<Tensor>& levels, const Tensor& camera);

  nn::Linear patch_embed_ = nullptr, lift_layer_ = nullptr, out_layer_ = nullptr, flow_layer_ = nullptr;
  ConvolutionStem stem_ = nullptr;
  Tensor pos_emb_, cells_, cell_emb_;  // cells_ [lift³, 3] their middles
  std::vector<nn::TransformerBlock> blocks_;
};
TORCH_MODULE(PatchImageEncoder);

}  // namespace anigen::vision
