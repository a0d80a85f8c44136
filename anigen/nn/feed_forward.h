#pragma once
#include "anigen/nn/linear.h"

namespace anigen::nn {

/// FFN(a→b; r): Linear(a→r·a) · gelu (tanh form) · Linear(r·a→b). Keys `mlp.0.*` and `mlp.2.*`
/// (reference autoencoders.md, 0.2). The hidden width follows the input width, not the output width.
class FeedForwardImpl : public torch::nn::Module {
 public:
  FeedForwardImpl(std::int64_t in_channels, std::int64_t out_channels, double mlp_ratio = 4.0);

  /// @param x [..., a] @return [..., b]
  Tensor forward(const Tensor& x) { return mlp_->forward(x); }
  torch::Dtype dtype() const { return mlp_->dtype(); }

 private:
  Mlp mlp_ = nullptr;
};
TORCH_MODULE(FeedForward);

}  // namespace anigen::nn
