#include "anigen/sparse/neighbour_map.h"

#include <ATen/Parallel.h>

#include <algorithm>

namespace anigen::sparse {
namespace {

constexpr std::int64_t kRowsPerThread = 4096;

// The sorted voxels of one item.
struct SortedItem {
  const std::uint64_t* keys;
  const std::int32_t* rows;
  std::int64_t count;
};

// Neighbours along z of one column of neighbours for the places begin … end: keys ascend together with those looked
// for, so that one walk along them finds all. @param map of the first of the three taps, taps `rows_in_all` apart
void find_column(const SortedItem& item, std::int64_t begin, std::int64_t end, std::uint64_t offset, std::int32_t* map,
                 std::int64_t rows_in_all) {
  const std::uint64_t* const last = item.keys + item.count;
  const std::uint64_t* at = std::lower_bound(item.keys, last, item.keys[begin] + offset - 1);
  for (std::int64_t place = begin; place < end; ++place) {
    const std::uint64_t below = item.keys[place] + offset - 1;
    while (at != last && *at < below) ++at;
    const std::uint64_t* found = at;
    for (std::uint64_t dz = 0; dz < 3; ++dz) {
      if (found == last || *found != below + dz) continue;
      map[static_cast<std::int64_t>(dz) * rows_in_all + item.rows[place]] = item.rows[found - item.keys];
      ++found;
    }
  }
}

}  // namespace

Tensor neighbour_map(const VoxelOrder& order, const nn::Ragged& items) {
  const std::int64_t rows = items.rows();
  const Tensor map = torch::full({27, rows}, -1, torch::kInt32);
  std::int32_t* const entries = map.data_ptr<std::int32_t>();
  for (std::int64_t i = 0; i < items.items(); ++i) {
    const SortedItem item{order.keys.data() + items.offset(i), order.rows.data() + items.offset(i),
                          items.lengths()[static_cast<std::size_t>(i)]};
    at::parallel_for(0, item.count, kRowsPerThread, [&](std::int64_t begin, std::int64_t end) {
      for (std::int64_t column = 0; column < 9; ++column) {
        // Unsigned: a step down is added modulo 2^64. Keys are above both strides and one, so no sum is negative.
        const std::uint64_t offset = (static_cast<std::uint64_t>(column / 3) - 1) * order.stride_x +
                                     (static_cast<std::uint64_t>(column % 3) - 1) * order.stride_y;
        find_column(item, begin, end, offset, entries + 3 * column * rows, rows);
      }
    });
  }
  return map;
}

}  // namespace anigen::sparse
