#pragma once
#include "anigen/nn/torch.h"

namespace anigen::models {

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
/// p = max((ceil(n / stride) − 1) · stride + k − n, 0) zeros, floor(p / 2) of them in front (reference
/// normal-estimator.md, 5). With a stride the padding thus depends on the size and need not be symmetric.
/// @param x [B, in, H, W] @param weight [out, in / groups, k, k] @param bias [out] or undefined
/// @return [B, out, ceil(H / stride), ceil(W / stride)]
Tensor same_convolution(const Tensor& x, const Tensor& weight, const Tensor& bias, std::int64_t stride = 1,
                        std::int64_t groups = 1);

}  // namespace anigen::models
