#pragma once
#include <vector>

#include "anigen/nn/linear.h"

namespace anigen::models::rignet {

using torch::Tensor;

/// Batch norm over rows (momentum 0.1). A single row has no spread to divide by: it is normed as in evaluation.
/// @param x [N, C]
Tensor batch_normed(torch::nn::BatchNorm1d& norm, const Tensor& x);

/// What every multilayer perceptron of RigNet is made of, in this order: Linear, ReLU, batch norm (reference
/// anymate-baselines.md, 9.3). Keys `linear.*`, `norm.*`.
class ReluNormImpl : public torch::nn::Module {
 public:
  ReluNormImpl(std::int64_t in, std::int64_t out);
  Tensor forward(const Tensor& x);  ///< @param x [N, in] @return [N, out]

 private:
  nn::Linear linear_ = nullptr;
  torch::nn::BatchNorm1d norm_ = nullptr;
};
TORCH_MODULE(ReluNorm);

/// Such layers after each other. Keys `0.*`, `1.*`, …
class DenseStackImpl : public torch::nn::Module {
 public:
  /// @param widths of the input, then of each layer's output
  explicit DenseStackImpl(const std::vector<std::int64_t>& widths);
  Tensor forward(Tensor x);  ///< @param x [N, first width] @return [N, last width]

 private:
  std::vector<ReluNorm> layers_;
};
TORCH_MODULE(DenseStack);

}  // namespace anigen::models::rignet
