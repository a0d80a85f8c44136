#pragma once
#include <array>
#include <cstdint>
#include <vector>

#include "anigen/nn/ragged.h"
#include "anigen/nn/torch.h"

namespace anigen::sparse {

using torch::Tensor;

/// Rows by ascending key, rows of equal keys in their order.
struct SortedKeys {
  std::vector<std::uint64_t> keys;
  std::vector<std::int32_t> rows;
};

/// A radix sort: linear in the number of keys, and it skips digits that all keys share. @param keys of rows 0, 1, …
SortedKeys sort_keys(std::vector<std::uint64_t> keys);

/// Number of voxels along each axis that make one voxel of a coarser grid.
struct GridFactor {
  GridFactor(std::int64_t all_axes) : axes{all_axes, all_axes, all_axes} {}  // one number stands for three
  GridFactor(std::int64_t x, std::int64_t y, std::int64_t z) : axes{x, y, z} {}
  bool operator<(const GridFactor& other) const { return axes < other.axes; }

  std::array<std::int64_t, 3> axes;  ///< x, y, z
};

/// The rows of each item sorted by their voxels x, y, z divided by `divisor`. A voxel's key is
/// (x + 1) · stride_x + (y + 1) · stride_y + z + 1, with strides large enough that the keys of its neighbours follow by
/// adding ± stride_x ± stride_y ± 1, also across the border of the grid.
struct VoxelOrder {
  std::uint64_t stride_x = 0, stride_y = 0;
  std::vector<std::uint64_t> keys;  ///< [N]; ascending within an item
  std::vector<std::int32_t> rows;   ///< [N]; of the support, in the order of keys
};

/// @param coords [N, 4] int32, CPU, contiguous, each below 2^20 @param items rows of each item
VoxelOrder voxel_order(const Tensor& coords, const nn::Ragged& items, const GridFactor& divisor);

/// Largest x, y, z, or 0 each without rows. @param coords as above
std::vector<std::int64_t> largest_coordinates(const Tensor& coords);

}  // namespace anigen::sparse
