#pragma once
#include "anigen/nn/torch.h"

namespace anigen::nn {

inline constexpr double kBlockNormEps =
    1e-6;  ///< layer norms inside transformer blocks (docs/reference/autoencoders.md, 1.2)

/// Layer norm over the last axis without parameters: biased variance, eps inside the root. 16-bit input is
/// normalised in fp32 and cast back. @param x [..., C] @return the shape and dtype of x
Tensor layer_norm(const Tensor& x, double eps = kBlockNormEps);

/// x / max(||x||_2, 1e-12) over the last axis.
Tensor unit_length(const Tensor& x);

/// Layer norm over the last axis with parameters `weight` [C] and `bias` [C]; biased variance, eps inside the root.
/// 16-bit input is normalised in fp32 and cast back. The parameters are not initialised: the model is filled from a
/// checkpoint (see Linear).
class AffineLayerNormImpl : public torch::nn::Module {
 public:
  AffineLayerNormImpl(std::int64_t channels, double eps);

  /// @param x [..., C] @return the shape and dtype of x
  Tensor forward(const Tensor& x);
  Tensor activated(const Tensor& x);  ///< SiLU of it (norm_silu)

  Tensor weight, bias;

 private:
  double eps_;
};
TORCH_MODULE(AffineLayerNorm);

/// q/k norm of attention: x_h / max(‖x_h‖₂, 1e-12) · γ_h · √D per head, in fp32, cast back (docs/reference/flows.md,
/// 1.4). Key `gamma` [H, D], initially ones.
class MultiHeadRmsNormImpl : public torch::nn::Module {
 public:
  MultiHeadRmsNormImpl(std::int64_t head_channels, std::int64_t num_heads);
  /// @param x [..., H, D] @return the same shape and dtype
  Tensor forward(const Tensor& x);
  Tensor gamma;
};
TORCH_MODULE(MultiHeadRmsNorm);

/// SiLU(LN(x) weight + bias) over the last dimension: biased variance, eps inside the root. fp32 on a CPU takes one
/// pass over memory forward and one backward, keeps only x and two numbers per row for it, gives the same bits for any
/// number of threads, and can be differentiated once. 16-bit input is normalised in fp32 and cast back before SiLU.
/// @param x [..., C] @param weight, bias [C] @return the shape and dtype of x
Tensor norm_silu(const Tensor& x, const Tensor& weight, const Tensor& bias, double eps);

}  // namespace anigen::nn
