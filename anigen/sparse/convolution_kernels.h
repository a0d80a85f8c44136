#pragma once
#include <cstdint>
#include <cstring>

#define ANIGEN_TILE_INLINE inline __attribute__((always_inline))

namespace anigen::sparse::kernels {

/// Columns of a panel of weights.
inline constexpr std::int64_t kPanel = 16;

/// Sums of kRows rows and one panel of columns, in vectors of kBytes. Loops over it are unrolled, so that the sums of a
/// tile of most_rows() rows are registers of the instruction set that has vectors of this size.
template <typename T, int kBytes, int kRows>
struct Tile {
  static constexpr int kLanes = kBytes / static_cast<int>(sizeof(T));
  static constexpr int kVectors = static_cast<int>(kPanel) / kLanes;
  typedef T Vector __attribute__((vector_size(kBytes)));
  typedef T Unaligned __attribute__((vector_size(kBytes), aligned(sizeof(T)), may_alias));
  Vector sums[kRows][kVectors];

  ANIGEN_TILE_INLINE void load_row(int row, const T* from) {
#pragma GCC unroll 16
    for (int v = 0; v < kVectors; ++v) sums[row][v] = reinterpret_cast<const Unaligned*>(from)[v];
  }
  ANIGEN_TILE_INLINE void load(int row, const T* from, std::int64_t width) {
    if (width == kPanel) return load_row(row, from);
    T padded[kPanel] = {};
    std::memcpy(padded, from, static_cast<std::size_t>(width) * sizeof(T));
    load_row(row, padded);
  }
  ANIGEN_TILE_INLINE void clear_row(int row) {
#pragma GCC unroll 16
    for (int v = 0; v < kVectors; ++v) sums[row][v] = Vector{};
  }
  ANIGEN_TILE_INLINE void add_row_to(int row, T* to) const {
#pragma GCC unroll 16
    for (int v = 0; v < kVectors; ++v) reinterpret_cast<Unaligned*>(to)[v] += sums[row][v];
  }
  ANIGEN_TILE_INLINE void store_row(int row, T* to) const {
#pragma GCC unroll 16
    for (int v = 0; v < kVectors; ++v) reinterpret_cast<Unaligned*>(to)[v] = sums[row][v];
  }
  ANIGEN_TILE_INLINE void store(int row, T* to, std::int64_t width) const {
    if (width == kPanel) return store_row(row, to);
    T padded[kPanel];
    store_row(row, padded);
    std::memcpy(to, padded, static_cast<std::size_t>(width) * sizeof(T));
  }
  /// sums[r] += factors(r) · panel_row
  template <typename Factors>
  ANIGEN_TILE_INLINE void step(const Factors& factors, const T* panel_row) {
    Vector row[kVectors];
#pragma GCC unroll 16
    for (int v = 0; v < kVectors; ++v) row[v] = reinterpret_cast<const Unaligned*>(panel_row)[v];
#pragma GCC unroll 16
    for (int r = 0; r < kRows; ++r) {
      const T factor = factors(r);
#pragma GCC unroll 16
      for (int v = 0; v < kVectors; ++v) sums[r][v] += factor * row[v];
    }
  }
};

/// Rows of the largest tile: twelve registers of sums, which leaves four of sixteen for what they are formed from.
template <typename T, int kBytes>
constexpr int most_rows() {
  return 12 / (static_cast<int>(kPanel) * static_cast<int>(sizeof(T)) / kBytes);
}

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

/// The forward product of convolution_kernels.h in bf16, where nn::kernels::has_bf16_products() says so: exact products
/// of bf16 numbers, passed as their 16 bits, added up in fp32.

/// Sizes that the kernel takes: an even number of input channels, output channels a multiple of 16.
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
