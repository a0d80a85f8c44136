#include "anigen/sparse/convolution.h"

#include <ATen/Dispatch.h>
#include <ATen/Parallel.h>
#include <algorithm>
#include <cstdlib>
#include <cstring>

#include "anigen/core/kernel_form.h"
#include "anigen/nn/kernels/bf16_products.h"
#include "anigen/nn/kernels/mixed_products.h"
#include "anigen/nn/kernels/tiles.h"

// Both products keep a tile of sums, some rows of one panel, in registers, and step along what is summed over: a vector
// of the panel and one number per row of the tile at each step. They are compiled once per form of kernels.
#if defined(__x86_64__) && defined(__GNUC__)
#define ANIGEN_SPARSE_X86 1
#else
#define ANIGEN_SPARSE_X86 0
#endif
#define ANIGEN_TILE_INLINE inline __attribute__((always_inline))

namespace anigen::sparse {

namespace {

// Columns of a panel of weights.
constexpr std::int64_t kPanel = 16;

// Sums of kRows rows and one panel of columns, in vectors of kBytes. Loops over it are unrolled, so that the sums of a
// tile of most_rows() rows are registers of the instruction set that has vectors of this size.
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
  // sums[r] += factors(r) · panel_row
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

// Rows of the largest tile: twelve registers of sums, which leaves four of sixteen for what they are formed from.
template <typename T, int kBytes>
constexpr int most_rows() {
  return 12 / (static_cast<int>(kPanel) * static_cast<int>(sizeof(T)) / kBytes);
}

// Pairs of rows, one of each matrix: what one tap of a convolution connects.
struct RowPairs {
  const std::int32_t* from;
  const std::int32_t* to;
  std::int64_t count;
};

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
  for (; channels >= kRows; channels -= kRows, pairs.factors += kRows, w += kRows * w_stride)
    correlate_tile<T, kBytes, kRows>(pairs, w, w_stride);
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
        for (; k + kRows <= channels; k += kRows, copied.factors += kRows * kPairBlock)
          correlate_tile<T, kBytes, kRows>(copied, sums + k * stride, stride);
        if constexpr (kRows > 1) correlate_rest<T, kBytes, kRows / 2>(copied, sums + k * stride, stride, channels - k);
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

// out[to[i], :] += in[from[i], :] · w for each pair; no row of `out` twice. Rows are read where they lie, and a sum is
// formed in the order of the input channels whatever pairs surround it.
// @param in rows of `in_channels` @param panels [⌈out_channels / kPanel⌉, in_channels, kPanel], filled up with zeros
// @param out rows of `out_channels`
template <typename T>
void multiply_pairs(const RowPairs& pairs, const T* in, std::int64_t in_channels, const T* panels, T* out,
                    std::int64_t out_channels) {
#if ANIGEN_SPARSE_X86
  const KernelForm form = kernel_form();
  if (form >= KernelForm::kAvx512) return multiply_avx512(pairs, in, in_channels, panels, out, out_channels);
  if (form >= KernelForm::kAvx2) return multiply_avx2(pairs, in, in_channels, panels, out, out_channels);
#endif
  multiply<T, 16>(pairs, in, in_channels, panels, out, out_channels);
}

// w += Σ in[from[i], first … first + count]ᵀ out[to[i], :], summed in the order of the pairs; an element of w does not
// depend on `first` and `count`.
// @param w [count, ⌈out_channels / kPanel⌉ · kPanel]; columns beyond out_channels are left as they are
template <typename T>
void correlate_pairs(const RowPairs& pairs, const T* in, std::int64_t in_channels, std::int64_t first,
                     std::int64_t count, const T* out, std::int64_t out_channels, T* w) {
#if ANIGEN_SPARSE_X86
  const KernelForm form = kernel_form();
  if (form >= KernelForm::kAvx512) return correlate_avx512(pairs, in, in_channels, first, count, out, out_channels, w);
  if (form >= KernelForm::kAvx2) return correlate_avx2(pairs, in, in_channels, first, count, out, out_channels, w);
#endif
  correlate<T, 16>(pairs, in, in_channels, first, count, out, out_channels, w);
}

using nn::kernels::kBf16Lanes;

constexpr std::int64_t kPanelColumns = 64;

// A matrix as the kernel for bf16 reads it: panels of up to 64 columns, [in_channels / 2, columns, 2] each.
// @param matrix [in_channels, out_channels]
void pack_bf16_matrix(const std::uint16_t* matrix, std::int64_t in_channels, std::int64_t out_channels,
                      std::uint16_t* packed) {
  for (std::int64_t first = 0; first < out_channels; first += kPanelColumns) {
    const std::int64_t columns = std::min(kPanelColumns, out_channels - first);
    for (std::int64_t k = 0; k < in_channels; k += 2) {
      for (std::int64_t c = 0; c < columns; ++c) {
        *packed++ = matrix[k * out_channels + first + c];
        *packed++ = matrix[(k + 1) * out_channels + first + c];
      }
    }
  }
}

#if ANIGEN_BF16_X86
ANIGEN_BF16_BEGIN
template <int kVectors>
ANIGEN_BF16 void multiply_panel(const RowPairs& pairs, const std::uint16_t* in, std::int64_t in_channels,
                                const std::uint16_t* panel, float* out, std::int64_t out_channels) {
  for (std::int64_t k = 0; k < in_channels; k += kDepth) {
    nn::kernels::bf16_rows<kVectors, true>([=](std::int64_t i) { return in + pairs.from[i] * in_channels + k; },
                                           [=](std::int64_t i) { return out + pairs.to[i] * out_channels; },
                                           pairs.count, std::min(kDepth, in_channels - k) / 2,
                                           panel + k * kVectors * kBf16Lanes, nn::kernels::NothingAhead{});
  }
}

constexpr std::int64_t kGathered = 32;  // rows of two tiles of AMX

// multiply_panel() by tiles, whose rows lie at constant distances: rows are gathered before, and sums scattered after
// the product.
template <int kVectors>
ANIGEN_BF16 void multiply_gathered(const RowPairs& pairs, const std::uint16_t* in, std::int64_t in_channels,
                                   const std::uint16_t* panel, float* out, std::int64_t out_channels) {
  alignas(64) std::uint16_t rows[kGathered * kDepth];
  alignas(64) float sums[kGathered * kPanelColumns];
  constexpr std::int64_t kColumns = kVectors * kBf16Lanes;
  nn::kernels::Bf16Multiplier multiplier;
  for (std::int64_t first = 0; first < pairs.count; first += kGathered) {
    const std::int64_t count = std::min(kGathered, pairs.count - first);
    for (std::int64_t k = 0; k < in_channels; k += kDepth) {
      const std::int64_t depth = std::min(kDepth, in_channels - k);
      for (std::int64_t i = 0; i < count; ++i)
        std::copy_n(in + pairs.from[first + i] * in_channels + k, depth, rows + i * depth);
      multiplier.multiply({rows, depth, panel + k * kColumns, sums, kColumns, count, depth / 2, kVectors}, k > 0);
    }
    for (std::int64_t i = 0; i < count; ++i) {
      float* const to = out + pairs.to[first + i] * out_channels;
      for (std::int64_t c = 0; c < kColumns; c += kBf16Lanes)
        _mm512_storeu_ps(to + c, _mm512_add_ps(_mm512_loadu_ps(to + c), _mm512_load_ps(sums + i * kColumns + c)));
    }
  }
}

// multiply_pairs() of bf16 numbers, passed as their 16 bits, where nn::kernels::has_bf16_products() says so: exact
// products, added up in fp32.
void multiply_bf16_pairs(const RowPairs& pairs, const std::uint16_t* in, std::int64_t in_channels,
                         const std::uint16_t* packed, float* out, std::int64_t out_channels) {
  using Panel = decltype(&multiply_panel<1>);
  static constexpr Panel kListed[] = {multiply_panel<1>, multiply_panel<2>, multiply_panel<3>, multiply_panel<4>};
  static constexpr Panel kGathering[] = {multiply_gathered<1>, multiply_gathered<2>, multiply_gathered<3>,
                                         multiply_gathered<4>};
  const Panel* const panels = nn::kernels::has_amx_products() ? kGathering : kListed;
  for (std::int64_t first = 0; first < out_channels; first += kPanelColumns) {
    const std::int64_t columns = std::min(kPanelColumns, out_channels - first);
    panels[columns / kBf16Lanes - 1](pairs, in, in_channels, packed, out + first, out_channels);
    packed += in_channels * columns;
  }
}
ANIGEN_BF16_END

#else

void multiply_bf16_pairs(const RowPairs&, const std::uint16_t*, std::int64_t, const std::uint16_t*, float*,
                         std::int64_t) {
  std::abort();  // has_bf16_products() said so
}

#endif

// Rows that are worked on before the next ones, tap after tap: few enough that what a block reads and writes stays in a
// second-level cache, enough for the matrices that pass by meanwhile to pay, and enough blocks for many threads.
// Independent of their number, so that the bits of the result are.
constexpr std::int64_t kFewestRows = 128, kCachedValues = 65536, kWantedBlocks = 32;

class RowBlocks {
 public:
  RowBlocks(const TapPlan& plan, std::int64_t rows, std::int64_t in_channels, std::int64_t out_channels) : rows_(rows) {
    const std::int64_t values = plan.from_children * in_channels + plan.to_children * out_channels;
    const std::int64_t most = std::max(kFewestRows, kCachedValues / std::max<std::int64_t>(1, values));
    length_ = std::clamp(rows / kWantedBlocks, kFewestRows, most);
  }
  std::int64_t count() const { return (rows_ + length_ - 1) / length_; }
  std::int64_t length() const { return length_; }
  std::int64_t begin(std::int64_t block) const { return block * length_; }
  std::int64_t end(std::int64_t block) const { return std::min(rows_, (block + 1) * length_); }

 private:
  std::int64_t rows_, length_;
};

// The pairs of rows that a link joins within a block; one list at a time.
class PairList {
 public:
  PairList(const TapPlan& plan, const Tensor& neighbours, std::int64_t most)
      : plan_(plan),
        neighbours_(neighbours.data_ptr<std::int32_t>()),
        rows_(neighbours.size(1)),
        from_(static_cast<std::size_t>(most)),
        to_(static_cast<std::size_t>(most)) {}

  RowPairs list(const TapLink& link, std::int64_t begin, std::int64_t end) {
    const std::int32_t* const found = neighbours_ + link.tap * rows_;
    std::size_t count = 0;
    for (std::int64_t row = begin; row < end; ++row) {  // writes every pair, and steps on where there is one
      from_[count] = static_cast<std::int32_t>(found[row] * plan_.from_children + link.from_child);
      to_[count] = static_cast<std::int32_t>(row * plan_.to_children + link.to_child);
      count += found[row] >= 0 ? 1 : 0;
    }
    return {from_.data(), to_.data(), static_cast<std::int64_t>(count)};
  }

 private:
  const TapPlan& plan_;
  const std::int32_t* neighbours_;
  std::int64_t rows_;
  std::vector<std::int32_t> from_, to_;
};

std::int64_t panels_of(std::int64_t channels) { return (channels + kPanel - 1) / kPanel; }

// [M, Cin, Cout] → [M, panels, Cin, kPanel]
Tensor in_panels(const Tensor& matrices) {
  const std::int64_t in_channels = matrices.size(1), panels = panels_of(matrices.size(2));
  const std::int64_t missing = panels * kPanel - matrices.size(2);
  const Tensor filled = missing > 0 ? at::constant_pad_nd(matrices, {0, missing}) : matrices;
  return filled.reshape({matrices.size(0), in_channels, panels, kPanel}).permute({0, 2, 1, 3}).contiguous();
}

// Calls multiply(pairs, link) for all rows, link after link.
template <typename Multiply>
void for_each_link(const TapPlan& plan, const Tensor& neighbours, std::int64_t in_channels, std::int64_t out_channels,
                   const Multiply& multiply) {
  const RowBlocks blocks(plan, neighbours.size(1), in_channels, out_channels);
  at::parallel_for(0, blocks.count(), 1, [&](std::int64_t first, std::int64_t last) {
    PairList pairs(plan, neighbours, blocks.length());
    for (std::int64_t block = first; block < last; ++block) {
      for (const TapLink& link : plan.links) multiply(pairs.list(link, blocks.begin(block), blocks.end(block)), link);
    }
  });
}

template <typename T>
void add_products(const TapPlan& plan, const Tensor& neighbours, const Tensor& in, const Tensor& panels, Tensor& out) {
  const std::int64_t in_channels = in.size(1), out_channels = out.size(1);
  const std::int64_t matrix_values = panels_of(out_channels) * in_channels * kPanel;
  const T *in_data = in.data_ptr<T>(), *panel_data = panels.data_ptr<T>();
  T* const out_data = out.data_ptr<T>();
  for_each_link(plan, neighbours, in_channels, out_channels, [&](const RowPairs& pairs, const TapLink& link) {
    multiply_pairs(pairs, in_data, in_channels, panel_data + link.matrix * matrix_values, out_data, out_channels);
  });
}

// Calls correlate(pairs, first and number of input channels, sums of these) for all matrices. Parallel over their
// halves (fewer would leave two threads with unequal shares), each summed over all rows in one order.
template <typename T, typename Correlate>
void for_each_correlation(const TapPlan& plan, const Tensor& neighbours, const Tensor& in, const Tensor& slopes,
                          Tensor& matrices, const Correlate& correlate) {
  const std::int64_t in_channels = in.size(1), out_channels = slopes.size(1), half = (in_channels + 1) / 2;
  const std::int64_t stride = matrices.size(2);
  T* const sums = matrices.data_ptr<T>();
  const RowBlocks blocks(plan, neighbours.size(1), in_channels, out_channels);
  at::parallel_for(0, 2 * plan.matrices(), 1, [&](std::int64_t begin, std::int64_t end) {
    PairList pairs(plan, neighbours, blocks.length());
    for (std::int64_t block = 0; block < blocks.count(); ++block) {
      for (std::int64_t i = begin / 2; i < (end + 1) / 2; ++i) {
        const TapLink& link = plan.links[static_cast<std::size_t>(i)];
        const std::int64_t first = 2 * i < begin ? half : 0, last = 2 * i + 1 < end ? in_channels : half;
        correlate(pairs.list(link, blocks.begin(block), blocks.end(block)), first, last - first,
                  sums + (link.matrix * in_channels + first) * stride);
      }
    }
  });
}

template <typename T>
void add_correlations(const TapPlan& plan, const Tensor& neighbours, const Tensor& in, const Tensor& slopes,
                      Tensor& matrices) {
  const T *in_data = in.data_ptr<T>(), *slope_data = slopes.data_ptr<T>();
  for_each_correlation<T>(plan, neighbours, in, slopes, matrices,
                          [&](const RowPairs& pairs, std::int64_t first, std::int64_t count, T* sums) {
                            correlate_pairs(pairs, in_data, in.size(1), first, count, slope_data, slopes.size(1), sums);
                          });
}

void add_mixed_correlations(const TapPlan& plan, const Tensor& neighbours, const Tensor& in, const Tensor& slopes,
                            Tensor& matrices) {
  const std::int64_t in_channels = in.size(1), out_channels = slopes.size(1), stride = matrices.size(2);
  const float *in_data = in.data_ptr<float>(), *slope_data = slopes.data_ptr<float>();
  for_each_correlation<float>(plan, neighbours, in, slopes, matrices,
                              [&](const RowPairs& pairs, std::int64_t first, std::int64_t count, float* sums) {
                                nn::kernels::correlate_mixed({in_data + first, in_channels, pairs.from},
                                                             {slope_data, out_channels, pairs.to}, pairs.count, count,
                                                             out_channels, sums, stride);
                              });
}

}  // namespace

void add_cpu_tap_product(const TapPlan& plan, const Tensor& neighbours, const Tensor& in, const Tensor& matrices,
                         Tensor& out) {
  const Tensor rows = in.contiguous(), panels = in_panels(matrices);
  AT_DISPATCH_FLOATING_TYPES(out.scalar_type(), "sparse convolution",
                             [&] { add_products<scalar_t>(plan, neighbours, rows, panels, out); });
}

bool fits_bf16_tap_product(const Tensor& matrices) {
  return nn::kernels::has_bf16_products() && matrices.size(1) % 2 == 0 && matrices.size(2) % kBf16Lanes == 0;
}

void add_bf16_tap_product(const TapPlan& plan, const Tensor& neighbours, const Tensor& in, const Tensor& matrices,
                          Tensor& out) {
  const Tensor rows = in.contiguous(), rounded = matrices.to(torch::kBFloat16).contiguous();
  const std::int64_t in_channels = in.size(1), out_channels = out.size(1), matrix_values = in_channels * out_channels;
  const Tensor packed = torch::empty_like(rounded);
  at::parallel_for(0, rounded.size(0), 1, [&](std::int64_t begin, std::int64_t end) {
    for (std::int64_t m = begin * matrix_values; m < end * matrix_values; m += matrix_values)
      pack_bf16_matrix(nn::bf16_bits(rounded) + m, in_channels, out_channels, nn::bf16_bits(packed) + m);
  });
  const std::uint16_t *in_data = nn::bf16_bits(rows), *packed_data = nn::bf16_bits(packed);
  float* const out_data = out.data_ptr<float>();
  for_each_link(plan, neighbours, in_channels, out_channels, [&](const RowPairs& pairs, const TapLink& link) {
    multiply_bf16_pairs(pairs, in_data, in_channels, packed_data + link.matrix * matrix_values, out_data, out_channels);
  });
}

Tensor cpu_tap_correlation(const TapPlan& plan, const Tensor& neighbours, const Tensor& in, const Tensor& slopes,
                           bool mixed) {
  const Tensor rows = in.contiguous(), slope_rows = slopes.contiguous();
  Tensor matrices = torch::zeros({plan.matrices(), in.size(1), panels_of(slopes.size(1)) * kPanel}, in.options());
  if (mixed) {
    add_mixed_correlations(plan, neighbours, rows, slope_rows, matrices);
  } else {
    AT_DISPATCH_FLOATING_TYPES(in.scalar_type(), "sparse convolution",
                               [&] { add_correlations<scalar_t>(plan, neighbours, rows, slope_rows, matrices); });
  }
  return matrices.narrow(2, 0, slopes.size(1));
}

}  // namespace anigen::sparse
