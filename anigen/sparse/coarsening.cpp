#include "anigen/sparse/coarsening.h"

#include <cstddef>

namespace anigen::sparse {

CoarseRows coarse_rows(const Tensor& coords, const nn::Ragged& items, const GridFactor& factor) {
  const VoxelOrder order = voxel_order(coords, items, factor);
  CoarseRows coarse;
  coarse.row = torch::empty({coords.size(0)}, torch::kInt64);
  auto* row_of = coarse.row.data_ptr<std::int64_t>();
  const std::int32_t* const fine = coords.data_ptr<std::int32_t>();
  std::vector<std::int32_t> places;
  std::vector<std::int64_t> counts;
  for (std::int64_t item = 0; item < items.items(); ++item) {
    const std::size_t before = counts.size();
    const std::int64_t first = items.offset(item);
    const std::int64_t last = first + items.lengths()[static_cast<std::size_t>(item)];
    for (std::int64_t i = first; i < last; ++i) {
      const auto at = static_cast<std::size_t>(i);
      if (i == first || order.keys[at] != order.keys[at - 1]) {
        const std::int32_t* const c = fine + 4 * order.rows[at];
        places.push_back(c[0]);
        for (std::size_t axis = 0; axis < 3; ++axis) {
          places.push_back(static_cast<std::int32_t>(c[axis + 1] / factor.axes[axis]));
        }
        counts.push_back(0);
      }
      ++counts.back();
      row_of[order.rows[at]] = static_cast<std::int64_t>(counts.size()) - 1;
    }
    coarse.lengths.push_back(static_cast<std::int64_t>(counts.size() - before));
  }
  const auto rows = static_cast<std::int64_t>(counts.size());
  coarse.coords = torch::tensor(places, torch::TensorOptions().dtype(torch::kInt32)).view({rows, 4});
  coarse.count = torch::tensor(counts, torch::TensorOptions().dtype(torch::kInt64));
  return coarse;
}

}  // namespace anigen::sparse
