#include "anigen/nn/rms_norm.h"

#include <cmath>

#include "anigen/nn/layer_norm.h"

namespace anigen::nn {

MultiHeadRmsNormImpl::MultiHeadRmsNormImpl(std::int64_t head_channels, std::int64_t num_heads) {
  gamma = register_parameter("gamma", torch::ones({num_heads, head_channels}));
}

Tensor MultiHeadRmsNormImpl::forward(const Tensor& x) {
  const torch::Dtype wide = accumulation_dtype(dtype_of(x));
  const Tensor factors = gamma.to(wide) * std::sqrt(static_cast<double>(gamma.size(1)));
  return (unit_length(x.to(wide)) * factors).to(dtype_of(x));
}

}  // namespace anigen::nn
