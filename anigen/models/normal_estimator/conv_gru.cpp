#include "anigen/models/normal_estimator/conv_gru.h"

namespace anigen::models {

ConvGruImpl::ConvGruImpl(std::int64_t hidden_channels, std::int64_t input_channels) {
  constexpr std::int64_t kKernel = 5;
  const std::int64_t all = hidden_channels + input_channels;
  convz_ = register_module("convz", Conv2d(all, hidden_channels, kKernel));
  convr_ = register_module("convr", Conv2d(all, hidden_channels, kKernel));
  convq_ = register_module("convq", Conv2d(all, hidden_channels, kKernel));
}

Tensor ConvGruImpl::forward(const Tensor& hidden, const Tensor& input) {
  const Tensor both = torch::cat({hidden, input}, 1);
  const Tensor update = torch::sigmoid(convz_(both)), reset = torch::sigmoid(convr_(both));
  const Tensor candidate = torch::tanh(convq_(torch::cat({reset * hidden, input}, 1)));
  return torch::lerp(hidden, candidate, update);
}

}  // namespace anigen::models
