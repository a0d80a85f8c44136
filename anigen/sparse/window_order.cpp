#include "anigen/sparse/window_order.h"

#include <algorithm>
#include <string>
#include <utility>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/sparse/voxel_order.h"

namespace anigen::sparse {
namespace {

// Strides of the published numbers: of an item, and of a step along x, y and z.
struct WindowStrides {
  std::uint64_t item, x, y;
};

WindowStrides window_strides(const Tensor& coords, std::int64_t items, std::int64_t size, std::int64_t shift) {
  constexpr std::uint64_t kMostWindows = std::uint64_t{1} << 62;
  const std::vector<std::int64_t> largest = largest_coordinates(coords);
  const auto windows = [&](std::size_t axis) { return static_cast<std::uint64_t>((largest[axis] + shift) / size + 1); };
  WindowStrides strides{1, 1, 1};
  std::uint64_t product = 1;
  const auto extend = [&](std::uint64_t count) {
    if (count > 0 && product > kMostWindows / count) {
      throw InputError("", "", "windows of " + std::to_string(size) + " voxels: their numbers would exceed 2^62");
    }
    return product *= count;
  };
  strides.y = extend(windows(2));
  strides.x = extend(windows(1));
  strides.item = extend(windows(0));
  extend(static_cast<std::uint64_t>(items));
  return strides;
}

Tensor int64_tensor(const std::vector<std::int64_t>& values) {
  return torch::tensor(values, torch::TensorOptions().dtype(torch::kInt64));
}

}  // namespace

WindowOrder window_order(const Tensor& coords, std::int64_t items, std::int64_t size, std::int64_t shift) {
  constexpr std::int64_t kLargestShift = std::int64_t{1} << 20;  // of a window: also the largest sensible size
  if (size < 1 || shift < 0 || shift > kLargestShift) {
    throw InputError("", "",
                     "windows of " + std::to_string(size) + " voxels shifted by " + std::to_string(shift) +
                         ": the size must be at least 1, the shift from 0 to 2^20");
  }
  const WindowStrides strides = window_strides(coords, items, size, shift);
  const std::int64_t rows = coords.size(0);
  const std::int32_t* c = coords.data_ptr<std::int32_t>();
  const auto along = [=](std::int32_t coordinate) { return static_cast<std::uint64_t>((coordinate + shift) / size); };
  std::vector<std::uint64_t> numbers(static_cast<std::size_t>(rows));
  for (std::uint64_t& number : numbers) {
    number = static_cast<std::uint64_t>(c[0]) * strides.item + along(c[1]) * strides.x + along(c[2]) * strides.y +
             along(c[3]);
    c += 4;
  }
  const SortedKeys sorted = sort_keys(std::move(numbers));

  WindowOrder windows;
  windows.order = torch::empty({rows}, torch::kInt64);
  windows.place = torch::empty({rows}, torch::kInt64);
  auto* order = windows.order.data_ptr<std::int64_t>();
  auto* place = windows.place.data_ptr<std::int64_t>();
  std::vector<std::int64_t> offsets, found;
  for (std::int64_t i = 0; i < rows; ++i) {
    const auto at = static_cast<std::size_t>(i);
    order[i] = sorted.rows[at];
    place[sorted.rows[at]] = i;
    if (i > 0 && sorted.keys[at] == sorted.keys[at - 1]) continue;
    offsets.push_back(i);
    found.push_back(static_cast<std::int64_t>(sorted.keys[at]));
  }
  offsets.push_back(rows);
  for (std::size_t w = 0; w < found.size(); ++w) {
    windows.longest = std::max(windows.longest, offsets[w + 1] - offsets[w]);
  }
  windows.offsets = int64_tensor(offsets);
  windows.windows = int64_tensor(found);
  return windows;
}

}  // namespace anigen::sparse
