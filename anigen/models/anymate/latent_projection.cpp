#include "anigen/models/anymate/latent_projection.h"

#include "anigen/models/anymate/checks.h"

namespace anigen::models::anymate {

TokenProjectionImpl::TokenProjectionImpl(const ProjectionWidths& widths) {
  first_ = register_module("0", nn::Linear(widths.in, widths.hidden_1));
  second_ = register_module("2", nn::Linear(widths.hidden_1, widths.hidden_2));
  third_ = register_module("4", nn::Linear(widths.hidden_2, widths.out));
}

Tensor TokenProjectionImpl::forward(const Tensor& tokens) {
  return third_(torch::gelu(second_(torch::gelu(first_(tokens)))));
}

PooledProjectionImpl::PooledProjectionImpl(const ProjectionWidths& widths, std::int64_t tokens) {
  each_ = register_module("0", TokenProjection(widths));
  sum_ = register_module("1", nn::Linear(tokens, 1));
}

Tensor PooledProjectionImpl::forward(const Tensor& tokens) {
  require_shape(tokens, {-1, sum_->weight.size(1), -1}, "tokens");
  return sum_(each_(tokens).transpose(1, 2)).squeeze(-1);
}

}  // namespace anigen::models::anymate
