#pragma once
#include "anigen/nn/torch.h"

namespace anigen::nn {

/// Low-rank addition to a linear map (reference flows-and-pipeline.md, 1.8): + scale · (x A) B.
struct Lora {
  std::int64_t rank = 0;  ///< 0: none
  double scale = 0.1;     ///< not divided by the rank, and not in a checkpoint
};

/// Affine map of the last axis with parameters `weight` [out, in] and `bias` [out], like torch::nn::Linear, but
/// without drawing initial values: the whole model is initialised once (see init.h) or filled from a checkpoint.
/// Building a published-size model only to list or load its parameters therefore touches no memory. With Lora also
/// `lora_A` [in, rank] and `lora_B` [rank, out].
class LinearImpl : public torch::nn::Module {
 public:
  LinearImpl(std::int64_t in_features, std::int64_t out_features, bool with_bias = true, const Lora& lora = {});

  /// @param x [..., in] of the dtype of the weight @return [..., out]
  Tensor forward(const Tensor& x);

  Tensor weight, bias, lora_A, lora_B;

 private:
  double lora_scale_;
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
