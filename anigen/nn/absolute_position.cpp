#include "anigen/nn/absolute_position.h"

namespace anigen::nn {

Tensor absolute_position_embedding(const Tensor& coordinates, std::int64_t channels) {
  TORCH_CHECK(coordinates.dim() == 2, "coordinates have the shape [N, axes], not ", coordinates.sizes());
  const std::int64_t axes = coordinates.size(1), count = channels / axes / 2;
  const auto options = coordinates.options().dtype(torch::kFloat32);
  // By the same fp32 operations as the published code.
  const Tensor exponents = torch::arange(count, options) / static_cast<double>(count);
  const Tensor frequencies = torch::pow(10000.0, exponents).reciprocal();
  const Tensor arguments = coordinates.to(torch::kFloat32).unsqueeze(-1) * frequencies;  // [N, axes, F]
  const Tensor waves = torch::cat({arguments.sin(), arguments.cos()}, -1).flatten(1);    // [N, axes · 2F]
  return torch::constant_pad_nd(waves, {0, channels - axes * 2 * count});
}

Tensor grid_coordinates(std::int64_t resolution) {
  const Tensor cells = torch::arange(resolution * resolution * resolution, torch::kInt64);
  const auto axis = [&](std::int64_t stride) { return torch::div(cells, stride, "floor").remainder(resolution); };
  return torch::stack({axis(resolution * resolution), axis(resolution), axis(1)}, 1);
}

}  // namespace anigen::nn
