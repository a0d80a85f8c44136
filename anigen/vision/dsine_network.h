#pragma once
#include <memory>
#include <vector>

#include "anigen/nn/torch.h"

namespace anigen::vision {

using torch::Tensor;

/// 2-D cross-correlation over [B, C, H, W] with keys `weight` [out, in / groups, k, k] and, unless switched off, `bias`
/// [out]; like torch::nn::Conv2d, but without drawing initial values (nn::Linear says why).
class Conv2dImpl : public torch::nn::Module {
 public:
  Conv2dImpl(std::int64_t in_channels, std::int64_t out_channels, std::int64_t kernel, bool with_bias = true,
             std::int64_t groups = 1);

  /// Stride 1; zeros around the picture, so that height and width stay. @param x [B, in, H, W] @return [B, out, H, W]
  Tensor forward(const Tensor& x);

  Tensor weight, bias;

 private:
  std::int64_t groups_;
};
TORCH_MODULE(Conv2d);

/// Cross-correlation with the "same" padding of TensorFlow: ceil(n / stride) outputs along an axis of n entries, from
/// p = max((ceil(n / stride) − 1) · stride + k − n, 0) zeros, floor(p / 2) of them in front (docs/reference/normals.md,
/// 4). With a stride the padding thus depends on the size and need not be symmetric.
/// @param x [B, in, H, W] @param weight [out, in / groups, k, k] @param bias [out] or undefined
/// @return [B, out, ceil(H / stride), ceil(W / stride)]
Tensor same_convolution(const Tensor& x, const Tensor& weight, const Tensor& bias, std::int64_t stride = 1,
                        std::int64_t groups = 1);

/// Batch norm in evaluation: keys `weight`, `bias`, `running_mean`, `running_var` [C] and
/// `num_batches_tracked`, an int64 scalar without influence.
class BatchNormStateImpl : public torch::nn::Module {
 public:
  explicit BatchNormStateImpl(std::int64_t channels);
  Tensor weight, bias, running_mean, running_var, num_batches_tracked;
};
TORCH_MODULE(BatchNormState);

/// A convolution without bias and the batch norm (epsilon 1e-3) after it as one convolution: in evaluation the norm is
/// an affine map of each output channel.
struct FoldedConvolution {
  FoldedConvolution(const Conv2d& convolution, const BatchNormState& norm);
  /// Output channels begin … end − 1 alone.
  FoldedConvolution channels(std::int64_t begin, std::int64_t end) const;
  /// same_convolution of x.
  Tensor apply(const Tensor& x, std::int64_t stride = 1, std::int64_t groups = 1) const;

  Tensor weight, bias;  ///< [out, in / groups, k, k], [out]

 private:
  FoldedConvolution() = default;
};

/// Every channel times a number in (0, 1) read from the means of all channels (Hu et al. 2018,
/// "Squeeze-and-Excitation Networks"): x ⊙ σ(W₂ swish(W₁ mean(x))). Keys `conv_reduce.*`, `conv_expand.*`.
class SqueezeExciteImpl : public torch::nn::Module {
 public:
  /// @param block_inputs channels that enter the block this stands in, a quarter of which is the narrow width
  SqueezeExciteImpl(std::int64_t channels, std::int64_t block_inputs);

  Tensor forward(Tensor x);  ///< @param x [B, C, H, W], overwritten

 private:
  Conv2d conv_reduce_ = nullptr, conv_expand_ = nullptr;
};
TORCH_MODULE(SqueezeExcite);

/// A block of EfficientNet (Tan and Le 2019, after MobileNetV2), in evaluation. A skip is added where the
/// shapes agree: stride 1 and as many channels out as in.
class EfficientNetBlockImpl : public torch::nn::Module {
 public:
  /// @param x [B, in, H, W] @return [B, out, ceil(H / stride), ceil(W / stride)]
  virtual Tensor forward(const Tensor& x) = 0;
};

/// 1 × 1 to six times the channels, depthwise k × k with the stride, squeeze and excite, 1 × 1. Keys `conv_pw`, `bn1`,
/// `conv_dw`, `bn2`, `se`, `conv_pwl`, `bn3`.
class InvertedResidualImpl : public EfficientNetBlockImpl {
 public:
  InvertedResidualImpl(std::int64_t in, std::int64_t out, std::int64_t kernel, std::int64_t stride);
  Tensor forward(const Tensor& x) override;

 private:
  Tensor expanded(const Tensor& x) const;  // the first two convolutions

  std::int64_t stride_;
  Conv2d conv_pw_ = nullptr, conv_dw_ = nullptr, conv_pwl_ = nullptr;
  BatchNormState bn1_ = nullptr, bn2_ = nullptr, bn3_ = nullptr;
  SqueezeExcite se_ = nullptr;
};

/// Features of the encoder that the decoder reads.
struct EncoderMaps {
  Tensor eighth;         ///< [B, 64, H/8, W/8]
  Tensor sixteenth;      ///< [B, 176, H/16, W/16]
  Tensor thirty_second;  ///< [B, 2048, H/32, W/32], before the norm and swish that would follow
};

/// EfficientNet-B5 with the padding and norms of the TensorFlow release (docs/reference/normals.md, 4), without pooling
/// and classifier; in evaluation. Keys `conv_stem.weight`, `bn1.*`, `blocks.<stage>.<block>.*`, `conv_head.weight`,
/// `bn2.*` (loaded, without influence).
class EfficientNetB5Impl : public torch::nn::Module {
 public:
  EfficientNetB5Impl();

  /// @param images [B, 3, H, W], normalised
  EncoderMaps forward(const Tensor& images);

 private:
  Conv2d conv_stem_ = nullptr, conv_head_ = nullptr;
  BatchNormState bn1_ = nullptr, bn2_ = nullptr;
  std::vector<std::vector<std::shared_ptr<EfficientNetBlockImpl>>> stages_;
};
TORCH_MODULE(EfficientNetB5);

/// Gated recurrent unit whose maps are 5 × 5 convolutions (Ballas et al. 2016): z = σ(convz[h, x]), r = σ(convr[h, x]),
/// h' = (1 − z) ⊙ h + z ⊙ tanh(convq[r ⊙ h, x]). Keys `convz.*`, `convr.*`, `convq.*`.
class ConvGruImpl : public torch::nn::Module {
 public:
  ConvGruImpl(std::int64_t hidden_channels, std::int64_t input_channels);
  /// @param hidden [B, hidden, H, W] @param input [B, input, H, W] @return the next hidden state
  Tensor forward(const Tensor& hidden, const Tensor& input);

 private:
  Conv2d convz_ = nullptr, convr_ = nullptr, convq_ = nullptr;
};
TORCH_MODULE(ConvGru);

/// Every pixel becomes 8 × 8, each a convex combination of the 3 × 3 pixels around it (Teed and Deng 2020, "RAFT",
/// section 3.3; docs/reference/normals.md, 7); beyond the border the nearest pixel of the border.
/// @param x [B, C, H, W] @param mask [B, 9 · 8 · 8, H, W]: neighbour, row and column within the pixel, from outer to
///   inner; before the softmax over the neighbours @return [B, C, 8 H, 8 W]
Tensor convex_upsampling(const Tensor& x, const Tensor& mask);

/// 3 × 3 convolution · ReLU · 1 × 1 · ReLU · 1 × 1, with keys `0.*`, `2.*` and `4.*`.
class PredictionHeadImpl : public torch::nn::Module {
 public:
  PredictionHeadImpl(std::int64_t in, std::int64_t hidden, std::int64_t out);
  Tensor forward(const Tensor& x);  ///< @param x [B, in, H, W] @return [B, out, H, W]

 private:
  Conv2d spatial_ = nullptr, hidden_ = nullptr, out_ = nullptr;
};
TORCH_MODULE(PredictionHead);

/// Convolution whose kernels are standardised before use (Qiao et al. 2019, "Micro-Batch Training with Batch-Channel
/// Normalization and Weight Standardization"): of each output channel's kernel the mean is taken off, and the rest
/// divided by its unbiased deviation + 1e-5. The keys hold the kernels before that.
class StandardizedConv2dImpl : public Conv2dImpl {
 public:
  using Conv2dImpl::Conv2dImpl;
  Tensor forward(const Tensor& x);
};
TORCH_MODULE(StandardizedConv2d);

/// Doubles a map: bilinear to the size of the skip, joined with it, then twice a standardised 3 × 3 convolution, group
/// norm of 8 groups and leaky ReLU (0.01). Keys `_net.{0,1,3,4}.*`.
class UpStageImpl : public torch::nn::Module {
 public:
  UpStageImpl(std::int64_t in, std::int64_t out);
  /// @param x [B, C, h, w] @param skip [B, in − C, H, W] @return [B, out, H, W]
  Tensor forward(const Tensor& x, const Tensor& skip);

 private:
  StandardizedConv2d first_ = nullptr, second_ = nullptr;
  torch::nn::GroupNorm first_norm_ = nullptr, second_norm_ = nullptr;
};
TORCH_MODULE(UpStage);

/// x / z and y / z of the rays at the three scales of the encoder's maps, [1, 2, H/s, W/s].
struct RaySlopes {
  Tensor eighth, sixteenth, thirty_second;
};

/// Start of the refinement, [B, ·, H/8, W/8].
struct DecoderMaps {
  Tensor normal;   ///< 3 channels, unit
  Tensor feature;  ///< 64 channels
  Tensor hidden;   ///< 64 channels, the first state of the recurrent unit
};

/// The decoder of DSINE (docs/reference/normals.md, 5): each map of the encoder joined with its rays. Keys `conv2.*`,
/// `up1.*`, `up2.*`, `normal_head.*`, `feature_head.*`, `hidden_head.*`.
class NormalDecoderImpl : public torch::nn::Module {
 public:
  NormalDecoderImpl();
  DecoderMaps forward(const EncoderMaps& maps, const RaySlopes& rays);

 private:
  Conv2d conv2_ = nullptr;
  UpStage up1_ = nullptr, up2_ = nullptr;
  PredictionHead normal_head_ = nullptr, feature_head_ = nullptr, hidden_head_ = nullptr;
};
TORCH_MODULE(NormalDecoder);

}  // namespace anigen::vision
