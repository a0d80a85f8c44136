#include "anigen/models/voxel_components.h"

#include <array>
#include <vector>

#include "anigen/core/error.h"

namespace anigen::models {

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

}  // namespace anigen::models
