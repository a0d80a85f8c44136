#pragma once
#include "anigen/models/normal_estimator/conv2d.h"

namespace anigen::models {

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

}  // namespace anigen::models
