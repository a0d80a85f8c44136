#pragma once
#include "anigen/nn/torch.h"

namespace anigen::nn {

/// Affine map of the last axis with parameters `weight` [out, in] and `bias` [out], like torch::nn::Linear, but
/// without drawing initial values: the whole model is initialised once (see init.h) or filled from a checkpoint.
/// Building a published-size model only to list or load its parameters therefore touches no memory.
class LinearImpl : public torch::nn::Module {
 public:
  LinearImpl(std::int64_t in_features, std::int64_t out_features, bool with_bias = true);

  /// @param x [..., in] of the dtype of the weight @return [..., out]
  Tensor forward(const Tensor& x);

  Tensor weight, bias;
};
TORCH_MODULE(Linear);

/// Linear(in→hidden) · gelu (tanh form) · Linear(hidden→out), with keys `0.{weight,bias}` and `2.{weight,bias}`
/// (reference autoencoders.md, 0.2).
class MlpImpl : public torch::nn::Module {
 public:
  MlpImpl(std::int64_t in_features, std::int64_t hidden_features, std::int64_t out_features);
  Tensor forward(const Tensor& x);
  torch::Dtype dtype() const { return dtype_of(first_->weight); }

 private:
  Linear first_ = nullptr, second_ = nullptr;
};
TORCH_MODULE(Mlp);

}  // namespace anigen::nn
