#include "anigen/sparse/convolution_kernels.h"

#include <algorithm>
#include <cstring>

#include "anigen/core/kernel_form.h"
#include "anigen/sparse/register_tile.h"

// Both products keep a tile of sums, some rows of one panel, in registers, and step along what is summed over: a vector
// of the panel and one number per row of the tile at each step. They are compiled once per form of kernels.
#if defined(__x86_64__) && defined(__GNUC__)
#define ANIGEN_SPARSE_X86 1
#else
#define ANIGEN_SPARSE_X86 0
#endif

namespace anigen::sparse::kernels {
namespace {

// Input channels between reading and writing a tile: the part of a panel used meanwhile stays in the first-level cache.
constexpr std::int64_t kDepth = 256;
// Pairs and channels of them that a weight gradient works on at a time.
constexpr std::int64_t kPairBlock = 128, kCopiedChannels = 96;

// A panel of weights [depth, kPanel] and the columns of `out` it concerns.
template <typename T>
struct PanelProduct {
  const T *in, *panel;
  T* out;
  std::int64_t in_channels, depth, out_channels, width;
};

template <typename T, int kBytes, int kRows>
ANIGEN_TILE_INLINE void multiply_tile(const PanelProduct<T>& p, const std::int32_t* from, const std::int32_t* to) {
  const T* rows[kRows];
  Tile<T, kBytes, kRows> tile;
#pragma GCC unroll 16
  for (int r = 0; r < kRows; ++r) {
    rows[r] = p.in + from[r] * p.in_channels;
    tile.load(r, p.out + to[r] * p.out_channels, p.width);
  }
  for (std::int64_t k = 0; k < p.depth; ++k) {
    tile.step([&](int r) { return rows[r][k]; }, p.panel + k * kPanel);
  }
#pragma GCC unroll 16
  for (int r = 0; r < kRows; ++r) tile.store(r, p.out + to[r] * p.out_channels, p.width);
}

// Tiles of kRows pairs, and smaller ones for the rest.
template <typename T, int kBytes, int kRows>
ANIGEN_TILE_INLINE void multiply_tiles(const PanelProduct<T>& p, const std::int32_t* from, const std::int32_t* to,
                                       std::int64_t count) {
  std::int64_t i = 0;
  for (; i + kRows <= count; i += kRows) multiply_tile<T, kBytes, kRows>(p, from + i, to + i);
  if constexpr (kRows > 1) multiply_tiles<T, kBytes, kRows / 2>(p, from + i, to + i, count - i);
}

template <typename T, int kBytes>
ANIGEN_TILE_INLINE void multiply(const RowPairs& pairs, const T* in, std::int64_t in_channels, const T* panels, T* out,
                                 std::int64_t out_channels) {
  for (std::int64_t k = 0; k < in_channels; k += kDepth) {
    for (std::int64_t column = 0; column < out_channels; column += kPanel) {
      const PanelProduct<T> p{in + k,
                              panels + (column / kPanel * in_channels + k) * kPanel,
                              out + column,
                              in_channels,
                              std::min(kDepth, in_channels - k),
                              out_channels,
                              std::min(kPanel, out_channels - column)};
      multiply_tiles<T, kBytes, most_rows<T, kBytes>()>(p, pairs.from, pairs.to, pairs.count);
    }
  }
}

// Some pairs: channels of their rows of `in` as factors [tile, kPairBlock, stride], one panel of their rows of `out`.
template <typename T>
struct CopiedPairs {
  const T *factors, *panel;
  std::int64_t count, stride;
};

// w[r, :] += Σ factors[i, r] · panel[i, :] for kRows of the factors of each pair.
template <typename T, int kBytes, int kRows>
ANIGEN_TILE_INLINE void correlate_tile(const CopiedPairs<T>& pairs, T* w, std::int64_t w_stride) {
  Tile<T, kBytes, kRows> tile;
#pragma GCC unroll 16
  for (int r = 0; r < kRows; ++r) tile.clear_row(r);
  for (std::int64_t i = 0; i < pairs.count; ++i) {
    const T* row = pairs.factors + i * pairs.stride;
    tile.step([&](int r) { return row[r]; }, pairs.panel + i * kPanel);
  }
#pragma GCC unroll 16
  for (int r = 0; r < kRows; ++r) tile.add_row_to(r, w + r * w_stride);
}

// The last channels, fewer than fill the largest tile.
template <typename T, int kBytes, int kRows>
ANIGEN_TILE_INLINE void correlate_rest(CopiedPairs<T> pairs, T* w, std::int64_t w_stride, std::int64_t channels) {
  for (; channels >= kRows; channels -= kRows, pairs.factors += kRows, w += kRows * w_stride) {
    correlate_tile<T, kBytes, kRows>(pairs, w, w_stride);
  }
  if constexpr (kRows > 1) correlate_rest<T, kBytes, kRows / 2>(pairs, w, w_stride, channels);
}

// [tile, kPairBlock, kRows], so that a tile's factors are next to each other: read where they lie, rows of 2^n channels
// would all want the same few places of the cache.
template <int kRows, typename T>
ANIGEN_TILE_INLINE void copy_factors(const std::int32_t* rows, std::int64_t count, const T* in,
                                     std::int64_t in_channels, std::int64_t channels, T* factors) {
  for (std::int64_t i = 0; i < count; ++i) {
    const T* row = in + rows[i] * in_channels;
    T* place = factors + i * kRows;
    std::int64_t k = 0;
    for (; k + kRows <= channels; k += kRows) std::memcpy(place + k * kPairBlock, row + k, kRows * sizeof(T));
    for (std::int64_t r = 0; k + r < channels; ++r) place[k * kPairBlock + r] = row[k + r];
  }
}

template <typename T>
ANIGEN_TILE_INLINE void copy_panel(const std::int32_t* rows, std::int64_t count, const T* out,
                                   std::int64_t out_channels, std::int64_t width, T* panel) {
  if (width < kPanel) std::fill_n(panel, count * kPanel, T(0));
  for (std::int64_t i = 0; i < count; ++i) {
    const T* row = out + rows[i] * out_channels;
    if (width == kPanel) {
      std::memcpy(panel + i * kPanel, row, kPanel * sizeof(T));
    } else {
      std::copy_n(row, width, panel + i * kPanel);
    }
  }
}

template <typename T, int kBytes>
ANIGEN_TILE_INLINE void correlate(const RowPairs& pairs, const T* in, std::int64_t in_channels, std::int64_t first,
                                  std::int64_t count, const T* out, std::int64_t out_channels, T* w) {
  constexpr int kRows = most_rows<T, kBytes>();
  static_assert(kCopiedChannels % kRows == 0, "whole tiles");
  const std::int64_t stride = (out_channels + kPanel - 1) / kPanel * kPanel;
  alignas(64) T panel[kPairBlock * kPanel];
  alignas(64) T factors[kPairBlock * kCopiedChannels];
  for (std::int64_t begin = 0; begin < pairs.count; begin += kPairBlock) {
    const std::int64_t block = std::min(kPairBlock, pairs.count - begin);
    for (std::int64_t c = 0; c < count; c += kCopiedChannels) {
      const std::int64_t channels = std::min(kCopiedChannels, count - c);
      copy_factors<kRows>(pairs.from + begin, block, in + first + c, in_channels, channels, factors);
      for (std::int64_t column = 0; column < out_channels; column += kPanel) {
        copy_panel(pairs.to + begin, block, out + column, out_channels, std::min(kPanel, out_channels - column), panel);
        CopiedPairs<T> copied{factors, panel, block, kRows};
        T* sums = w + c * stride + column;
        std::int64_t k = 0;
        for (; k + kRows <= channels; k += kRows, copied.factors += kRows * kPairBlock) {
          correlate_tile<T, kBytes, kRows>(copied, sums + k * stride, stride);
        }
        if constexpr (kRows > 1) {
          correlate_rest<T, kBytes, kRows / 2>(copied, sums + k * stride, stride, channels - k);
        }
      }
    }
  }
}

#if ANIGEN_SPARSE_X86
#define ANIGEN_AVX512 __attribute__((target("avx512f")))
#define ANIGEN_AVX2 __attribute__((target("avx2,fma")))

template <typename T>
ANIGEN_AVX512 void multiply_avx512(const RowPairs& pairs, const T* in, std::int64_t in_channels, const T* panels,
                                   T* out, std::int64_t out_channels) {
  multiply<T, 64>(pairs, in, in_channels, panels, out, out_channels);
}

template <typename T>
ANIGEN_AVX2 void multiply_avx2(const RowPairs& pairs, const T* in, std::int64_t in_channels, const T* panels, T* out,
                               std::int64_t out_channels) {
  multiply<T, 32>(pairs, in, in_channels, panels, out, out_channels);
}

template <typename T>
ANIGEN_AVX512 void correlate_avx512(const RowPairs& pairs, const T* in, std::int64_t in_channels, std::int64_t first,
                                    std::int64_t count, const T* out, std::int64_t out_channels, T* w) {
  correlate<T, 64>(pairs, in, in_channels, first, count, out, out_channels, w);
}

template <typename T>
ANIGEN_AVX2 void correlate_avx2(const RowPairs& pairs, const T* in, std::int64_t in_channels, std::int64_t first,
                                std::int64_t count, const T* out, std::int64_t out_channels, T* w) {
  correlate<T, 32>(pairs, in, in_channels, first, count, out, out_channels, w);
}
#endif

template <typename T>
void multiply_any(const RowPairs& pairs, const T* in, std::int64_t in_channels, const T* panels, T* out,
                  std::int64_t out_channels) {
#if ANIGEN_SPARSE_X86
  const KernelForm form = kernel_form();
  if (form >= KernelForm::kAvx512) return multiply_avx512(pairs, in, in_channels, panels, out, out_channels);
  if (form >= KernelForm::kAvx2) return multiply_avx2(pairs, in, in_channels, panels, out, out_channels);
#endif
  multiply<T, 16>(pairs, in, in_channels, panels, out, out_channels);
}

template <typename T>
void correlate_any(const RowPairs& pairs, const T* in, std::int64_t in_channels, std::int64_t first, std::int64_t count,
                   const T* out, std::int64_t out_channels, T* w) {
#if ANIGEN_SPARSE_X86
  const KernelForm form = kernel_form();
  if (form >= KernelForm::kAvx512) return correlate_avx512(pairs, in, in_channels, first, count, out, out_channels, w);
  if (form >= KernelForm::kAvx2) return correlate_avx2(pairs, in, in_channels, first, count, out, out_channels, w);
#endif
  correlate<T, 16>(pairs, in, in_channels, first, count, out, out_channels, w);
}

}  // namespace

void multiply_pairs(const RowPairs& pairs, const float* in, std::int64_t in_channels, const float* panels, float* out,
                    std::int64_t out_channels) {
  multiply_any(pairs, in, in_channels, panels, out, out_channels);
}

void multiply_pairs(const RowPairs& pairs, const double* in, std::int64_t in_channels, const double* panels,
                    double* out, std::int64_t out_channels) {
  multiply_any(pairs, in, in_channels, panels, out, out_channels);
}

void correlate_pairs(const RowPairs& pairs, const float* in, std::int64_t in_channels, std::int64_t first,
                     std::int64_t count, const float* out, std::int64_t out_channels, float* w) {
  correlate_any(pairs, in, in_channels, first, count, out, out_channels, w);
}

void correlate_pairs(const RowPairs& pairs, const double* in, std::int64_t in_channels, std::int64_t first,
                     std::int64_t count, const double* out, std::int64_t out_channels, double* w) {
  correlate_any(pairs, in, in_channels, first, count, out, out_channels, w);
}

}  // namespace anigen::sparse::kernels
