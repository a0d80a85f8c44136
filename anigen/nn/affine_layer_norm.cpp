#include "anigen/nn/affine_layer_norm.h"

#include "anigen/nn/modulated_rows.h"
#include "anigen/nn/norm_silu.h"

namespace anigen::nn {

AffineLayerNormImpl::AffineLayerNormImpl(std::int64_t channels, double eps) : eps_(eps) {
  weight = register_parameter("weight", torch::empty({channels}));
  bias = register_parameter("bias", torch::empty({channels}));
}

Tensor AffineLayerNormImpl::forward(const Tensor& x) { return affine_norm(x, weight, bias, eps_); }

Tensor AffineLayerNormImpl::activated(const Tensor& x) { return norm_silu(x, weight, bias, eps_); }

}  // namespace anigen::nn
