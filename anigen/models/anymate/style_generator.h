#pragma once
#include <vector>

#include "anigen/models/anymate/style_layers.h"

namespace anigen::models::anymate {

struct StyleGeneratorOptions {
  std::int64_t z_dim = 768, w_dim = 768;
  std::int64_t mapping_layers = 2;
  std::int64_t img_resolution = 256;  ///< power of two, at least 4
  std::int64_t img_channels = 96;
  std::int64_t channel_base = 32768, channel_max = 512;  ///< a layer of side s has min(base / s, max) channels
};

/// One resolution of the generator. Keys `const` (side 4 only), `resample_filter`, `conv0.*` (other sides), `conv1.*`,
/// `torgb.*`.
class StyleBlockImpl : public torch::nn::Module {
 public:
  /// @param in channels of the side below; 0 for the first block
  StyleBlockImpl(std::int64_t in, std::int64_t out, std::int64_t side, const StyleGeneratorOptions& options);
  /// Replaces features and image by those of twice the side. @param w [B, w_dim]
  void forward(Tensor& features, Tensor& image, const Tensor& w, StyleNoise noise);
  void initialize();

 private:
  Tensor const_, resample_filter_;
  StyledConv conv0_ = nullptr, conv1_ = nullptr;
  ToImage torgb_ = nullptr;
};
TORCH_MODULE(StyleBlock);

/// An image from a vector by StyleGAN2 with skips between resolutions, for unlabelled vectors and without truncation
/// (reference anymate-baselines.md, 3.7). Keys `synthesis.b<side>.*` and `mapping.{w_avg, fc<i>.*}`.
class StyleGeneratorImpl : public torch::nn::Module {
 public:
  /// Parameters are not initialised. @throws InputError for a resolution that is no power of two from 4 on
  explicit StyleGeneratorImpl(const StyleGeneratorOptions& options);

  Tensor style(const Tensor& z);  ///< @param z [B, z_dim] @return [B, w_dim], the same for all layers
  /// @param w [B, w_dim] @return [B, img_channels, R, R]
  Tensor image(const Tensor& w, StyleNoise noise);
  /// Convolutions and the last map to the image, each of which could have a style of its own.
  std::int64_t num_ws() const { return 2 * static_cast<std::int64_t>(blocks_.size()); }
  void initialize();

 private:
  std::vector<EqualizedLinear> mapping_;
  Tensor w_avg_;
  std::vector<StyleBlock> blocks_;
};
TORCH_MODULE(StyleGenerator);

}  // namespace anigen::models::anymate
