#pragma once
#include "anigen/sparse/support.h"
#include "anigen/sparse/voxel_order.h"

namespace anigen::sparse {

/// Coarse voxels and which one each row falls into: Support::coarsened, without a support.
struct CoarseRows {
  Tensor coords;                      ///< [M, 4] int32
  Tensor row, count;                  ///< as in Coarsening
  std::vector<std::int64_t> lengths;  ///< coarse rows of each item
};

/// @param coords [N, 4] int32, CPU, contiguous @param items rows of each item @param factor at least 1
/// along every axis
CoarseRows coarse_rows(const Tensor& coords, const nn::Ragged& items, const GridFactor& factor);

}  // namespace anigen::sparse
