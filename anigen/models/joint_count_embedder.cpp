#include "anigen/models/joint_count_embedder.h"

#include <cmath>

namespace anigen::models {

using torch::Tensor;

Tensor joint_count_features(const Tensor& joints_num, std::int64_t most, std::int64_t bands, torch::Dtype dtype) {
  // Arguments are rounded to `grid`; the functions themselves are evaluated in fp32, which fp16 kernels do as well.
  const torch::Dtype grid = dtype == torch::kHalf ? torch::kHalf : torch::promoteTypes(dtype, torch::kFloat32);
  const torch::Dtype wide = torch::promoteTypes(grid, torch::kFloat32);
  const auto rounded = [&](const Tensor& x) { return x.to(grid).to(wide); };
  const auto options = torch::TensorOptions().dtype(wide).device(joints_num.device());
  const Tensor part = rounded((joints_num.to(wide) / static_cast<double>(most)).clamp(0.0, 1.0));
  const Tensor frequencies = rounded(torch::pow(2.0, torch::arange(bands, options)) * M_PI);
  const Tensor arguments = rounded(part.unsqueeze(1) * frequencies);
  return torch::cat({arguments.sin(), arguments.cos()}, 1).to(dtype);
}

JointCountEmbedderImpl::JointCountEmbedderImpl(std::int64_t channels, std::int64_t most, std::int64_t bands)
    : most_(most), bands_(bands) {
  first_ = register_module("0", nn::Linear(2 * bands, channels));
  second_ = register_module("2", nn::Linear(channels, channels));
}

Tensor JointCountEmbedderImpl::forward(const Tensor& joints_num, const Tensor& unconditional) {
  const Tensor features = joint_count_features(joints_num, most_, bands_, nn::dtype_of(first_->weight));
  const Tensor embedding = second_->forward(torch::silu(first_->forward(features)));
  return torch::where((joints_num <= 0).unsqueeze(1), unconditional, embedding);
}

}  // namespace anigen::models
