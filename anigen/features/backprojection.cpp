#include "anigen/features/backprojection.h"

namespace anigen::features {

Tensor project_points(const Tensor& points, const Tensor& extrinsics, const Tensor& intrinsics) {
  const Tensor ones = torch::ones({points.size(0), 1}, points.options());
  const Tensor homogeneous = torch::cat({points, ones}, 1);
  const Tensor camera = torch::matmul(homogeneous, extrinsics.transpose(1, 2)).slice(2, 0, 3);
  const Tensor picture = torch::matmul(camera, intrinsics.transpose(1, 2));
  return picture.slice(2, 0, 2) / picture.slice(2, 2, 3) * 2.0 - 1.0;
}

Tensor sample_patches(const Tensor& patches, std::int64_t rows, std::int64_t columns, const Tensor& uv) {
  TORCH_CHECK(patches.dim() == 3 && patches.size(1) == rows * columns && uv.size(0) == patches.size(0), "patches ",
              patches.sizes(), " for ", rows, " x ", columns, " patches and projections ", uv.sizes());
  // Beyond ±2 everything is zero even for a single patch; grid_sample turns larger numbers into undefined integers.
  constexpr double kOutside = 4.0;
  const Tensor safe = torch::nan_to_num(uv, kOutside, kOutside, -kOutside).clamp(-kOutside, kOutside);
  const Tensor maps = patches.transpose(1, 2).reshape({patches.size(0), patches.size(2), rows, columns});
  namespace F = torch::nn::functional;
  const Tensor sampled = F::grid_sample(
      maps, safe.unsqueeze(1),
      F::GridSampleFuncOptions().mode(torch::kBilinear).padding_mode(torch::kZeros).align_corners(false));
  return sampled.squeeze(2).transpose(1, 2);
}

void ViewMean::add(const Tensor& per_view) {
  for (std::int64_t v = 0; v < per_view.size(0); ++v) {
    const Tensor view = per_view[v].detach().to(torch::kFloat32);
    sum_ = sum_.defined() ? sum_.add_(view) : view.clone();
    ++views_;
  }
}

Tensor ViewMean::mean() const {
  TORCH_CHECK(views_ > 0, "the mean of no view");
  return sum_ / static_cast<double>(views_);
}

}  // namespace anigen::features
