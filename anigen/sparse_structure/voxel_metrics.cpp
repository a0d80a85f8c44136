#include "anigen/sparse_structure/voxel_metrics.h"

#include <array>
#include <utility>
#include <vector>

#include "anigen/core/error.h"

namespace anigen::sparse_structure {

using torch::Tensor;

Tensor largest_component(const Tensor& occupied) {
  if (occupied.dim() != 3) throw InputError("", "", "a grid of voxels has three axes");
  const Tensor grid = occupied.to(torch::kBool).contiguous();
  const std::array<std::int64_t, 3> size{grid.size(0), grid.size(1), grid.size(2)};
  const std::array<std::int64_t, 3> stride{size[1] * size[2], size[2], 1};
  const bool* there = grid.data_ptr<bool>();
  std::vector<std::int32_t> label(static_cast<std::size_t>(grid.numel()), 0);
  std::vector<std::int64_t> queue;
  std::int32_t next = 0, best = 0;
  std::size_t best_count = 0;
  for (std::int64_t start = 0; start < grid.numel(); ++start) {
    if (!there[start] || label[static_cast<std::size_t>(start)] != 0) continue;
    label[static_cast<std::size_t>(start)] = ++next;
    queue.assign(1, start);
    for (std::size_t head = 0; head < queue.size(); ++head) {
      for (std::size_t axis = 0; axis < 3; ++axis) {
        const std::int64_t position = queue[head] / stride[axis] % size[axis];
        for (const std::int64_t step : {-1, 1}) {
          if (position + step < 0 || position + step >= size[axis]) continue;
          const std::int64_t neighbour = queue[head] + step * stride[axis];
          std::int32_t& mark = label[static_cast<std::size_t>(neighbour)];
          if (!there[neighbour] || mark != 0) continue;
          mark = next;
          queue.push_back(neighbour);
        }
      }
    }
    if (queue.size() > best_count) {
      best_count = queue.size();
      best = next;
    }
  }
  Tensor kept = torch::zeros_like(grid);
  bool* keep = kept.data_ptr<bool>();
  for (std::size_t i = 0; i < label.size(); ++i) keep[i] = best != 0 && label[i] == best;
  return kept;
}

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

namespace {

double voxel_count(const Tensor& voxels) { return static_cast<double>(voxels.sum().item<std::int64_t>()); }

double voxel_share(const Tensor& part, const Tensor& whole) {
  const double count = voxel_count(whole);
  return count > 0.0 ? voxel_count(part) / count : 1.0;
}

constexpr std::pair<const char*, OccupancyLoss> kOccupancyLosses[] = {  // in the order of the enum
    {"dice", OccupancyLoss::kDice},
    {"bce", OccupancyLoss::kBce},
    {"l1", OccupancyLoss::kL1}};

Tensor dice(const Tensor& probability, const Tensor& occupancy) {
  const Tensor common = (probability * occupancy).sum();
  return 1.0 - (2.0 * common + 1.0) / (probability.sum() + occupancy.sum() + 1.0);
}

}  // namespace

Tensor dilated_voxels(const Tensor& occupied, std::int64_t radius) {
  if (radius == 0) return occupied;
  const Tensor grid = occupied.to(torch::kFloat32).unsqueeze(0).unsqueeze(0);
  return torch::max_pool3d(grid, 2 * radius + 1, /*stride=*/1, /*padding=*/radius).squeeze(0).squeeze(0) > 0.5;
}

VoxelAgreement voxel_agreement(const Tensor& predicted, const Tensor& target, std::int64_t tolerance) {
  if (predicted.dim() != 3 || predicted.sizes() != target.sizes())
    throw InputError("", "", "voxel metrics compare two grids [X, Y, Z] of one size");
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

OccupancyLoss occupancy_loss_named(const std::string& name) {
  for (const auto& [word, loss] : kOccupancyLosses) {
    if (word == name) return loss;
  }
  throw InputError("", "loss_type", "expected dice, bce or l1, found '" + name + "'");
}

std::string name_of(OccupancyLoss loss) { return kOccupancyLosses[static_cast<std::size_t>(loss)].first; }

Tensor occupancy_loss(const Tensor& logits, const Tensor& occupancy, OccupancyLoss loss) {
  if (logits.sizes() != occupancy.sizes()) throw InputError("", "", "logits and occupancy differ in shape");
  const torch::Dtype dtype = nn::accumulation_dtype(logits.scalar_type());
  const Tensor l = logits.to(dtype), y = occupancy.to(dtype);
  if (loss == OccupancyLoss::kBce) return torch::binary_cross_entropy_with_logits(l, y);
  const Tensor probability = torch::sigmoid(l);
  return loss == OccupancyLoss::kDice ? dice(probability, y) : (probability - y).abs().mean();
}

Tensor posterior_kl(const Tensor& mean, const Tensor& logvar) {
  return 0.5 * (mean.square() + logvar.exp() - logvar - 1.0).mean();
}

}  // namespace anigen::sparse_structure
