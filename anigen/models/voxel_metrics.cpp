#include "anigen/models/voxel_metrics.h"

#include "anigen/core/error.h"

namespace anigen::models {
namespace {

using torch::Tensor;

double voxel_count(const Tensor& voxels) { return static_cast<double>(voxels.sum().item<std::int64_t>()); }

double voxel_share(const Tensor& part, const Tensor& whole) {
  const double count = voxel_count(whole);
  return count > 0.0 ? voxel_count(part) / count : 1.0;
}

}  // namespace

Tensor dilated_voxels(const Tensor& occupied, std::int64_t radius) {
  if (radius == 0) return occupied;
  const Tensor grid = occupied.to(torch::kFloat32).unsqueeze(0).unsqueeze(0);
  return torch::max_pool3d(grid, 2 * radius + 1, /*stride=*/1, /*padding=*/radius).squeeze(0).squeeze(0) > 0.5;
}

VoxelAgreement voxel_agreement(const Tensor& predicted, const Tensor& target, std::int64_t tolerance) {
  if (predicted.dim() != 3 || predicted.sizes() != target.sizes()) {
    throw InputError("", "", "voxel metrics compare two grids [X, Y, Z] of one size");
  }
  const torch::NoGradGuard no_grad;
  const Tensor p = predicted.to(torch::kBool), t = target.to(torch::kBool);
  VoxelAgreement agreement;
  agreement.iou = voxel_share(p.logical_and(t), p.logical_or(t));
  agreement.precision = voxel_share(p.logical_and(dilated_voxels(t, tolerance)), p);
  agreement.recall = voxel_share(t.logical_and(dilated_voxels(p, tolerance)), t);
  const double sum = agreement.precision + agreement.recall;
  agreement.f1 = sum > 0.0 ? 2.0 * agreement.precision * agreement.recall / sum : 0.0;
  return agreement;
}

}  // namespace anigen::models
