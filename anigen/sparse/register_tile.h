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

}  // namespace anigen::sparse::kernels
