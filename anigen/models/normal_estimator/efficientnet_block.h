#pragma once
#include "anigen/models/normal_estimator/folded_norm.h"

namespace anigen::models {

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

/// Depthwise k × k, squeeze and excite, 1 × 1. Keys `conv_dw`, `bn1`, `se`, `conv_pw`, `bn2`.
class DepthwiseSeparableImpl : public EfficientNetBlockImpl {
 public:
  DepthwiseSeparableImpl(std::int64_t in, std::int64_t out, std::int64_t kernel);
  Tensor forward(const Tensor& x) override;

 private:
  Conv2d conv_dw_ = nullptr, conv_pw_ = nullptr;
  BatchNormState bn1_ = nullptr, bn2_ = nullptr;
  SqueezeExcite se_ = nullptr;
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

}  // namespace anigen::models
