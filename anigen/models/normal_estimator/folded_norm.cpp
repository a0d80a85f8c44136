#include "anigen/models/normal_estimator/folded_norm.h"

namespace anigen::models {

BatchNormStateImpl::BatchNormStateImpl(std::int64_t channels) {
  weight = register_parameter("weight", torch::empty({channels}));
  bias = register_parameter("bias", torch::empty({channels}));
  running_mean = register_buffer("running_mean", torch::empty({channels}));
  running_var = register_buffer("running_var", torch::empty({channels}));
  num_batches_tracked = register_buffer("num_batches_tracked", torch::zeros({}, torch::kInt64));
}

FoldedConvolution::FoldedConvolution(const Conv2d& convolution, const BatchNormState& norm) {
  constexpr double kEps = 1e-3;
  const Tensor scale = norm->weight / (norm->running_var + kEps).sqrt();
  weight = convolution->weight * scale.view({-1, 1, 1, 1});
  bias = norm->bias - norm->running_mean * scale;
}

FoldedConvolution FoldedConvolution::channels(std::int64_t begin, std::int64_t end) const {
  FoldedConvolution part;
  part.weight = weight.slice(0, begin, end);
  part.bias = bias.slice(0, begin, end);
  return part;
}

Tensor FoldedConvolution::apply(const Tensor& x, std::int64_t stride, std::int64_t groups) const {
  return same_convolution(x, weight, bias, stride, groups);
}

}  // namespace anigen::models
