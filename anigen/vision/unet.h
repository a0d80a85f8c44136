#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "anigen/core/config_fields.h"
#include "anigen/nn/blocks.h"
#include "anigen/nn/linear.h"
#include "anigen/nn/torch.h"

namespace anigen::vision {

using torch::Tensor;

/// Sizes of a U-Net, of which our models of pictures consist; their options begin with these.
struct UNetOptions {
  std::int64_t image_size = 128;  ///< pixels on a side, a multiple of 16
  std::int64_t width = 192;       ///< channels of the blocks, at a sixteenth of the size; a multiple of 64
  std::int64_t num_blocks = 4;
  std::int64_t num_heads = 6;
  double mlp_ratio = 4.0;

  void fields(ConfigFields& f);
  /// @throws InputError at the field of `pointer` in `file` that is not valid
  void validate(const std::string& file, const std::string& pointer) const;
  std::int64_t map_channels() const;  ///< of UNetFeatures::map, an eighth of the width
};

/// Padded convolution, which keeps the size at stride 1.
torch::nn::Conv2d convolution(std::int64_t in, std::int64_t out, std::int64_t kernel, std::int64_t stride = 1);
/// Group norm without parameters over groups of 8 channels, then the exact GELU. @param x [B, C, H, W], C a multiple
/// of 8
Tensor activated(const Tensor& x);
/// Twice the size by bilinear interpolation. @param x [B, C, H, W]
Tensor doubled(const Tensor& x);

struct UNetFeatures {
  Tensor map;     ///< [B, width / 8, S/2, S/2]
  Tensor tokens;  ///< [B, (S/16)², width] of the lowest level, layer-normed, rows of patches from the top
};

/// U-Net of convolutions (Ronneberger et al. 2015) whose lowest level is a transformer over patches of 16 pixels.
/// Always fp32.
class UNetImpl : public torch::nn::Module {
 public:
  /// @param options validated
  explicit UNetImpl(const UNetOptions& options);

  /// @param images [B, 3, S, S] fp32 in [0, 1] @throws InputError on another shape
  UNetFeatures forward(const Tensor& images);

 private:
  UNetOptions options_;
  std::vector<torch::nn::Conv2d> down_, refine_, across_, up_;  // by level, fine to coarse
  std::vector<nn::TransformerBlock> blocks_;
  Tensor pos_emb_;
};
TORCH_MODULE(UNet);

}  // namespace anigen::vision
