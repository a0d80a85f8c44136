#pragma once
#include "anigen/sparse/support.h"

namespace anigen::sparse {

/// Support::windows. @param coords [N, 4] int32, CPU, contiguous @param items number of items @throws InputError for a
/// window below 1, a shift below 0, or numbers of windows beyond 2^62
WindowOrder window_order(const Tensor& coords, std::int64_t items, std::int64_t size, std::int64_t shift);

/// Rows in the order of their windows. The backward pass reads rows at their places instead of adding them up, which is
/// faster, and deterministic on a GPU. @param rows [N, ...]
Tensor to_window_order(const Tensor& rows, const WindowOrder& windows);
/// The inverse.
Tensor from_window_order(const Tensor& rows, const WindowOrder& windows);

/// Sequences of queries and keys for ragged_attention, from row offsets of both.
struct PairedOffsets {
  Tensor queries, keys;  ///< [S + 1] int64, CPU
};

/// One sequence per window number that either side has, by ascending number.
PairedOffsets pair_windows(const WindowOrder& queries, const WindowOrder& keys);

/// Row of each of the 27 neighbours of each row, −1 where there is none: Support::neighbours. Runs parallel; the time
/// grows linearly with the rows. @param order voxel_order(coords, items, 1) of the support @return [27, N] int32
Tensor neighbour_map(const VoxelOrder& order, const nn::Ragged& items);

}  // namespace anigen::sparse
