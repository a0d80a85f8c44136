#pragma once
#include <cstdint>

namespace anigen::models::anymate {

/// What the attention heads of all tasks share, under the released argument names.
struct HeadOptions {
  std::int64_t width = 768, heads = 12;
  std::int64_t num_freqs = 8;  ///< of the Fourier features of positions, with the factor π
  bool qkv_bias = false;
  double init_scale = 0.25;  ///< taken as the standard deviation itself, as released, so that training starts with
                             ///< large weights
};

}  // namespace anigen::models::anymate
