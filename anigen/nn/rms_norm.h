#pragma once
#include "anigen/nn/torch.h"

namespace anigen::nn {

/// q/k norm of attention: x_h / max(‖x_h‖₂, 1e-12) · γ_h · √D per head, in fp32, cast back (reference
/// flows-and-pipeline.md, 1.5). Key `gamma` [H, D], initially ones.
class MultiHeadRmsNormImpl : public torch::nn::Module {
 public:
  MultiHeadRmsNormImpl(std::int64_t head_channels, std::int64_t num_heads);
  /// @param x [..., H, D] @return the same shape and dtype
  Tensor forward(const Tensor& x);
  Tensor gamma;
};
TORCH_MODULE(MultiHeadRmsNorm);

}  // namespace anigen::nn
