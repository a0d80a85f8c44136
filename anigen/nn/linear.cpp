#include "anigen/nn/linear.h"

#include "anigen/nn/fused_mlp.h"
#include "anigen/nn/gelu.h"
#include "anigen/nn/widened_linear.h"

namespace anigen::nn {

LinearImpl::LinearImpl(std::int64_t in_features, std::int64_t out_features, bool with_bias, const Lora& lora)
    : lora_scale_(lora.scale) {
  weight = register_parameter("weight", torch::empty({out_features, in_features}));
  if (with_bias) bias = register_parameter("bias", torch::empty({out_features}));
  if (lora.rank == 0) return;
  lora_A = register_parameter("lora_A", torch::empty({in_features, lora.rank}));
  lora_B = register_parameter("lora_B", torch::empty({lora.rank, out_features}));
}

Tensor LinearImpl::forward(const Tensor& x) {
  const Tensor y = prefers_widened_linear(x, weight) ? widened_linear(x, weight, bias) : torch::linear(x, weight, bias);
  return lora_A.defined() ? y.add(torch::matmul(torch::matmul(x, lora_A), lora_B), lora_scale_) : y;
}

MlpImpl::MlpImpl(std::int64_t in_features, std::int64_t hidden_features, std::int64_t out_features) {
  first_ = register_module("0", Linear(in_features, hidden_features));
  second_ = register_module("2", Linear(hidden_features, out_features));
}

Tensor MlpImpl::forward(const Tensor& x) {
  if (prefers_fused_mlp(x, first_->weight)) {
    return fused_mlp(x, first_->weight, first_->bias, second_->weight, second_->bias);
  }
  return second_->forward(gelu_tanh(first_->forward(x)));
}

}  // namespace anigen::nn
