#include "anigen/models/normal_estimator/prediction_head.h"

namespace anigen::models {

PredictionHeadImpl::PredictionHeadImpl(std::int64_t in, std::int64_t hidden, std::int64_t out) {
  spatial_ = register_module("0", Conv2d(in, hidden, 3));
  hidden_ = register_module("2", Conv2d(hidden, hidden, 1));
  out_ = register_module("4", Conv2d(hidden, out, 1));
}

Tensor PredictionHeadImpl::forward(const Tensor& x) {
  Tensor y = spatial_(x);
  y = hidden_(torch::relu_(y));
  return out_(torch::relu_(y));
}

}  // namespace anigen::models
