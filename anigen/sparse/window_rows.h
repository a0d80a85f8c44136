#pragma once
#include "anigen/sparse/support.h"

namespace anigen::sparse {

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

}  // namespace anigen::sparse
