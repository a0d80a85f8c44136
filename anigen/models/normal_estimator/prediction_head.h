#pragma once
#include "anigen/models/normal_estimator/conv2d.h"

namespace anigen::models {

/// 3 × 3 convolution · ReLU · 1 × 1 · ReLU · 1 × 1, with keys `0.*`, `2.*` and `4.*`.
class PredictionHeadImpl : public torch::nn::Module {
 public:
  PredictionHeadImpl(std::int64_t in, std::int64_t hidden, std::int64_t out);
  Tensor forward(const Tensor& x);  ///< @param x [B, in, H, W] @return [B, out, H, W]

 private:
  Conv2d spatial_ = nullptr, hidden_ = nullptr, out_ = nullptr;
};
TORCH_MODULE(PredictionHead);

}  // namespace anigen::models
