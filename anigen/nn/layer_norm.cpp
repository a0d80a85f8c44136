#include "anigen/nn/layer_norm.h"

namespace anigen::nn {

Tensor layer_norm(const Tensor& x, double eps) {
  const torch::Dtype dtype = dtype_of(x);
  const Tensor normed = torch::layer_norm(x.to(accumulation_dtype(dtype)), {x.size(-1)}, {}, {}, eps);
  return normed.to(dtype);
}

Tensor unit_length(const Tensor& x) { return x / x.norm(2, -1, /*keepdim=*/true).clamp_min(1e-12); }

}  // namespace anigen::nn
