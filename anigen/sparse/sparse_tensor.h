#pragma once
#include "anigen/sparse/support.h"

namespace anigen::sparse {

/// Features at the places of a support, one row per voxel (reference autoencoders.md, 0.1). Copies are shallow.
struct SparseTensor {
  SupportPtr support;
  Tensor feats;  ///< [N, C]

  /// Other features at the same places. @param rows [N, C']
  SparseTensor with(Tensor rows) const { return {support, std::move(rows)}; }
  std::int64_t channels() const { return feats.size(1); }
};

}  // namespace anigen::sparse
