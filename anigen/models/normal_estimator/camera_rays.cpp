#include "anigen/models/normal_estimator/camera_rays.h"

#include <algorithm>
#include <cmath>

#include "anigen/core/numeric.h"

namespace anigen::models {
namespace {

Tensor pair_of(double u, double v, const Tensor& like) {
  return torch::tensor({u, v}, torch::kFloat64).view({1, 2, 1, 1}).to(like.options());
}

}  // namespace

PinholeCamera PinholeCamera::of_picture(std::int64_t height, std::int64_t width) {
  constexpr double kHalfAngle = kPi / 6.0;
  const double focal = 0.5 * static_cast<double>(std::max(height, width)) / std::tan(kHalfAngle);
  return {focal, focal, 0.5 * static_cast<double>(width), 0.5 * static_cast<double>(height)};
}

PinholeCamera PinholeCamera::padded(std::int64_t left, std::int64_t top) const {
  return {focal_u, focal_v, center_u + static_cast<double>(left), center_v + static_cast<double>(top)};
}

PinholeCamera PinholeCamera::reduced(std::int64_t factor) const {
  const auto by = static_cast<double>(factor);
  return {focal_u / by, focal_v / by, center_u / by, center_v / by};
}

Tensor PinholeCamera::focal(const Tensor& like) const { return pair_of(focal_u, focal_v, like); }
Tensor PinholeCamera::center(const Tensor& like) const { return pair_of(center_u, center_v, like); }

Tensor unit_vectors(const Tensor& v) { return v / v.norm(2, {1}, /*keepdim=*/true).clamp_min(1e-12); }

Tensor pixel_centers(std::int64_t rows, std::int64_t columns, const Tensor& like) {
  const Tensor u = (torch::arange(columns, like.options()) + 0.5).view({1, columns}).expand({rows, columns});
  const Tensor v = (torch::arange(rows, like.options()) + 0.5).view({rows, 1}).expand({rows, columns});
  return torch::stack({u, v}).unsqueeze(0);
}

Tensor ray_slopes(const PinholeCamera& camera, std::int64_t rows, std::int64_t columns, const Tensor& like) {
  return (pixel_centers(rows, columns, like) - camera.center(like)) / camera.focal(like);
}

Tensor unit_rays(const Tensor& slopes) {
  return unit_vectors(torch::cat({slopes, torch::ones_like(slopes.slice(1, 0, 1))}, 1));
}

Tensor ray_relu(const Tensor& normals, const Tensor& rays) {
  constexpr double kLeast = 0.01, kSmallestNorm = 1e-8;
  const auto norm = [](const Tensor& v) { return v.norm(2, {1}, /*keepdim=*/true).clamp_min(kSmallestNorm); };
  const Tensor cosine = (normals * rays).sum(1, /*keepdim=*/true) / (norm(normals) * norm(rays));
  return unit_vectors(normals + rays * (cosine.clamp_min(kLeast) - cosine));
}

}  // namespace anigen::models
