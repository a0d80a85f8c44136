#pragma once
#include <cstdint>

#include "anigen/sparse/convolution_kernels.h"

namespace anigen::sparse::kernels {

/// The forward product of convolution_kernels.h in bf16, where nn::kernels::has_bf16_products() says so: exact products
/// of bf16 numbers, passed as their 16 bits, added up in fp32.

/// What the kernel takes: an even number of input channels, output channels a multiple of 16.
bool bf16_pairs_take(std::int64_t in_channels, std::int64_t out_channels);

/// A matrix as the kernel reads it: panels of up to 64 columns, [in_channels / 2, columns, 2] each.
/// @param matrix [in_channels, out_channels]
void pack_bf16_matrix(const std::uint16_t* matrix, std::int64_t in_channels, std::int64_t out_channels,
                      std::uint16_t* packed);

/// out[to[i], :] += in[from[i], :] · w for each pair; no row of `out` twice. A sum is formed in the order of the input
/// channels whatever pairs surround it.
void multiply_bf16_pairs(const RowPairs& pairs, const std::uint16_t* in, std::int64_t in_channels,
                         const std::uint16_t* packed, float* out, std::int64_t out_channels);

}  // namespace anigen::sparse::kernels
