#include "anigen/models/rignet/dense_layers.h"

#include <string>

namespace anigen::models::rignet {

Tensor batch_normed(torch::nn::BatchNorm1d& norm, const Tensor& x) {
  if (x.size(0) > 1) return norm(x);
  return torch::batch_norm(x, norm->weight, norm->bias, norm->running_mean, norm->running_var, /*training=*/false,
                           /*momentum=*/0.0, norm->options.eps(), /*cudnn_enabled=*/false);
}

ReluNormImpl::ReluNormImpl(std::int64_t in, std::int64_t out) {
  linear_ = register_module("linear", nn::Linear(in, out));
  norm_ = register_module("norm", torch::nn::BatchNorm1d(out));
}

Tensor ReluNormImpl::forward(const Tensor& x) { return batch_normed(norm_, torch::relu(linear_(x))); }

DenseStackImpl::DenseStackImpl(const std::vector<std::int64_t>& widths) {
  for (std::size_t i = 0; i + 1 < widths.size(); ++i) {
    layers_.push_back(register_module(std::to_string(i), ReluNorm(widths[i], widths[i + 1])));
  }
}

Tensor DenseStackImpl::forward(Tensor x) {
  for (ReluNorm& layer : layers_) x = layer(x);
  return x;
}

}  // namespace anigen::models::rignet
