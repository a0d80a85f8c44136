#pragma once
#include "anigen/nn/torch.h"

namespace anigen::nn {

/// Layer norm over the last axis with parameters `weight` [C] and `bias` [C]; biased variance, eps inside the root.
/// 16-bit input is normalised in fp32 and cast back. The parameters are not initialised: the model is filled from a
/// checkpoint (see Linear).
class AffineLayerNormImpl : public torch::nn::Module {
 public:
  AffineLayerNormImpl(std::int64_t channels, double eps);

  /// @param x [..., C] @return the shape and dtype of x
  Tensor forward(const Tensor& x);
  Tensor activated(const Tensor& x);  ///< SiLU of it (norm_silu.h)

  Tensor weight, bias;

 private:
  double eps_;
};
TORCH_MODULE(AffineLayerNorm);

}  // namespace anigen::nn
