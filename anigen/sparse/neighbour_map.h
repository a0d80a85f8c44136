#pragma once
#include "anigen/sparse/voxel_order.h"

namespace anigen::sparse {

/// Row of each of the 27 neighbours of each row, −1 where there is none: Support::neighbours. Runs parallel; the time
/// grows linearly with the rows. @param order voxel_order(coords, items, 1) of the support @return [27, N] int32
Tensor neighbour_map(const VoxelOrder& order, const nn::Ragged& items);

}  // namespace anigen::sparse
