#pragma once
#include <cstdint>

#include "anigen/sparse/register_tile.h"

namespace anigen::sparse::kernels {

/// Pairs of rows, one of each matrix: what one tap of a convolution connects.
struct RowPairs {
  const std::int32_t* from;
  const std::int32_t* to;
  std::int64_t count;
};

/// out[to[i], :] += in[from[i], :] · w for each pair; no row of `out` twice. Rows are read where they lie, and a sum is
/// formed in the order of the input channels whatever pairs surround it.
/// @param in rows of `in_channels` @param panels [⌈out_channels / kPanel⌉, in_channels, kPanel], filled up with zeros
/// @param out rows of `out_channels`
void multiply_pairs(const RowPairs& pairs, const float* in, std::int64_t in_channels, const float* panels, float* out,
                    std::int64_t out_channels);
void multiply_pairs(const RowPairs& pairs, const double* in, std::int64_t in_channels, const double* panels,
                    double* out, std::int64_t out_channels);

/// w += Σ in[from[i], first … first + count]ᵀ out[to[i], :], summed in the order of the pairs; an element of w does not
/// depend on `first` and `count`.
/// @param w [count, ⌈out_channels / kPanel⌉ · kPanel]; columns beyond out_channels are left as they are
void correlate_pairs(const RowPairs& pairs, const float* in, std::int64_t in_channels, std::int64_t first,
                     std::int64_t count, const float* out, std::int64_t out_channels, float* w);
void correlate_pairs(const RowPairs& pairs, const double* in, std::int64_t in_channels, std::int64_t first,
                     std::int64_t count, const double* out, std::int64_t out_channels, double* w);

}  // namespace anigen::sparse::kernels
