#pragma once
#include <vector>

#include "anigen/nn/torch.h"

namespace anigen::anymate {

using torch::Tensor;

/// Affine map whose stored weights have unit variance and are scaled when used (Karras et al. 2018, "equalised learning
/// rate"): x · (weight · m / √in)ᵀ + bias · m, m being the rate multiplier. Keys `weight` [out, in], `bias` [out].
class EqualizedLinearImpl : public torch::nn::Module {
 public:
  EqualizedLinearImpl(std::int64_t in, std::int64_t out, double rate_multiplier = 1.0);
  Tensor forward(const Tensor& x);           ///< @param x [..., in] @return [..., out]
  void initialize(double first_bias = 0.0);  ///< N(0, 1 / m²) weights

  Tensor weight, bias;

 private:
  double rate_multiplier_;
};
TORCH_MODULE(EqualizedLinear);

/// Source of the noise of a style layer.
enum class StyleNoise {
  kRandom,  ///< drawn from torch's default generator, as while training
  kConst,   ///< the stored map
  kNone
};

/// 3 x 3 convolution whose weights are scaled by a style and brought back to unit variance (Karras et al. 2020,
/// "StyleGAN2"; docs/reference/anymate.md, 3.7), then noise, bias and a leaky ReLU of slope 0.2 and gain √2. Keys
/// `weight` [out, in, 3, 3], `noise_strength`, `bias`, `resample_filter`, `noise_const`, `affine.*`.
class StyledConvImpl : public torch::nn::Module {
 public:
  /// @param side of the output @param up doubles height and width
  StyledConvImpl(std::int64_t in, std::int64_t out, std::int64_t style, std::int64_t side, bool up);
  /// @param x [B, in, S, S] @param w [B, style] @return [B, out, side, side]
  Tensor forward(const Tensor& x, const Tensor& w, StyleNoise noise);
  void initialize();

 private:
  bool up_;
  Tensor weight_, noise_strength_, bias_, resample_filter_, noise_const_;
  EqualizedLinear affine_ = nullptr;
};
TORCH_MODULE(StyledConv);

/// 1 x 1 convolution under a style, nothing else: features to image. Keys `weight` [out, in, 1, 1], `bias`, `affine.*`.
class ToImageImpl : public torch::nn::Module {
 public:
  ToImageImpl(std::int64_t in, std::int64_t out, std::int64_t style);
  Tensor forward(const Tensor& x, const Tensor& w);  ///< @param x [B, in, S, S] @return [B, out, S, S]
  void initialize();

 private:
  Tensor weight_, bias_;
  EqualizedLinear affine_ = nullptr;
};
TORCH_MODULE(ToImage);

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
/// (docs/reference/anymate.md, 3.7). Keys `synthesis.b<side>.*` and `mapping.{w_avg, fc<i>.*}`.
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

}  // namespace anigen::anymate
