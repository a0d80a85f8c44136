#include "anigen/nn/affine_layer_norm.h"

namespace anigen::nn {

AffineLayerNormImpl::AffineLayerNormImpl(std::int64_t channels, double eps) : eps_(eps) {
  weight = register_parameter("weight", torch::empty({channels}));
  bias = register_parameter("bias", torch::empty({channels}));
}

Tensor AffineLayerNormImpl::forward(const Tensor& x) {
  const torch::Dtype wide = accumulation_dtype(dtype_of(x));
  return torch::layer_norm(x.to(wide), {x.size(-1)}, weight.to(wide), bias.to(wide), eps_).to(dtype_of(x));
}

}  // namespace anigen::nn
