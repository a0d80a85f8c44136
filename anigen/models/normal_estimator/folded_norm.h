#pragma once
#include "anigen/models/normal_estimator/conv2d.h"

namespace anigen::models {

/// What batch norm keeps for evaluation: keys `weight`, `bias`, `running_mean`, `running_var` [C] and
/// `num_batches_tracked`, an int64 scalar without influence.
class BatchNormStateImpl : public torch::nn::Module {
 public:
  explicit BatchNormStateImpl(std::int64_t channels);
  Tensor weight, bias, running_mean, running_var, num_batches_tracked;
};
TORCH_MODULE(BatchNormState);

/// A convolution without bias and the batch norm (epsilon 1e-3) after it as one convolution: in evaluation the norm is
/// an affine map of each output channel.
struct FoldedConvolution {
  FoldedConvolution(const Conv2d& convolution, const BatchNormState& norm);
  /// Output channels begin … end − 1 alone.
  FoldedConvolution channels(std::int64_t begin, std::int64_t end) const;
  /// same_convolution of x.
  Tensor apply(const Tensor& x, std::int64_t stride = 1, std::int64_t groups = 1) const;

  Tensor weight, bias;  ///< [out, in / groups, k, k], [out]

 private:
  FoldedConvolution() = default;
};

}  // namespace anigen::models
