#include "anigen/models/normal_estimator/normal_propagation.h"

#include <vector>

namespace anigen::models {
namespace {

constexpr std::int64_t kRadius = 2;
constexpr double kSmallestDepthSlope = 1e-8;

Tensor inner_product(const Tensor& a, const Tensor& b) { return (a * b).sum(1, /*keepdim=*/true); }

}  // namespace

Tensor neighborhood(const Tensor& x, std::int64_t radius) {
  const std::int64_t height = x.size(2), width = x.size(3), side = 2 * radius + 1;
  const Tensor wider = at::replication_pad2d(x, {radius, radius, radius, radius});
  std::vector<Tensor> all;
  for (std::int64_t row = 0; row < side; ++row) {
    for (std::int64_t column = 0; column < side; ++column) {
      all.push_back(wider.narrow(2, row, height).narrow(3, column, width));
    }
  }
  return torch::stack(all, 2);
}

Tensor rotation_axes(const Tensor& normals, const Tensor& directions, const Tensor& places,
                     const PinholeCamera& camera) {
  const Tensor focal = camera.focal(normals).unsqueeze(2), center = camera.center(normals).unsqueeze(2);
  const Tensor across = normals.slice(1, 0, 2), forward = normals.slice(1, 2, 3);
  const Tensor step = directions / focal;
  const Tensor slopes = (places + directions - center) / focal;
  Tensor facing = inner_product(slopes, across) + forward;  // 0 for a plane seen edge-on
  facing = torch::where(facing.abs() < kSmallestDepthSlope, kSmallestDepthSlope * facing.sign(), facing);
  const Tensor depth = -inner_product(step, across) / facing;
  const Tensor axes = unit_vectors(torch::cat({step + depth * slopes, depth}, 1));
  return axes.masked_fill(axes.isfinite().all(1, /*keepdim=*/true).logical_not(), 0.0);
}

Tensor rotated(const Tensor& vectors, const Tensor& axes, const Tensor& angles) {
  const Tensor no_axis = (axes == 0.0).all(1, /*keepdim=*/true);
  const Tensor turn = angles.masked_fill(no_axis, 0.0);  // the formula would shorten by cos(angle)
  const Tensor cosine = turn.cos(), across = at::linalg_cross(axes, vectors, 1);
  return vectors * cosine + across * turn.sin() + axes * (inner_product(axes, vectors) * (1.0 - cosine));
}

Tensor propagated_normals(const Tensor& normals, const NeighborRotations& rotations, const PinholeCamera& camera,
                          const Tensor& rays) {
  const Tensor around = neighborhood(normals, kRadius);
  const Tensor places = neighborhood(pixel_centers(normals.size(2), normals.size(3), normals), kRadius);
  const Tensor axes = rotation_axes(around, rotations.directions, places, camera);
  const Tensor turned = unit_vectors(rotated(around, axes, rotations.angles.unsqueeze(1)));
  const Tensor facing = ray_relu(turned, rays.unsqueeze(2));
  return unit_vectors((rotations.weights.unsqueeze(1) * facing).sum(2));
}

}  // namespace anigen::models
