#include "anigen/models/voxel_inside.h"

#include "anigen/core/error.h"

namespace anigen::models {

using torch::Tensor;

Tensor enclosed_voxels(const Tensor& surface) {
  if (surface.dim() != 3) throw InputError("", "", "a grid of voxels has three axes");
  const Tensor occupied = surface.to(torch::kInt32);
  constexpr int kDirections = 5;
  Tensor met = torch::zeros_like(occupied);
  for (std::int64_t axis = 0; axis < 3; ++axis) {
    met += (occupied.cumsum(axis) > 0).to(torch::kInt32);
    met += (occupied.flip(axis).cumsum(axis).flip(axis) > 0).to(torch::kInt32);
  }
  return (met >= kDirections).logical_or(occupied > 0);
}

double share_inside(const Tensor& skeleton, const Tensor& surface) {
  if (skeleton.sizes() != surface.sizes()) throw InputError("", "", "skeleton and surface lie on different grids");
  const Tensor bones = skeleton.to(torch::kBool);
  const auto count = bones.sum().item<std::int64_t>();
  if (count == 0) return 1.0;
  const auto inside = bones.logical_and(enclosed_voxels(surface)).sum().item<std::int64_t>();
  return static_cast<double>(inside) / static_cast<double>(count);
}

}  // namespace anigen::models
