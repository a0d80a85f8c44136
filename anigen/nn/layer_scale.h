#pragma once
#include "anigen/nn/torch.h"

namespace anigen::nn {

/// x ⊙ gamma with one learned factor per channel (Touvron et al. 2021, CaiT). Key `gamma` [C], not initialised: the
/// model is filled from a checkpoint (see Linear).
class LayerScaleImpl : public torch::nn::Module {
 public:
  explicit LayerScaleImpl(std::int64_t channels) { gamma = register_parameter("gamma", torch::empty({channels})); }

  /// @param x [..., C] @return [..., C]
  Tensor forward(const Tensor& x) { return x * gamma; }

  Tensor gamma;
};
TORCH_MODULE(LayerScale);

}  // namespace anigen::nn
