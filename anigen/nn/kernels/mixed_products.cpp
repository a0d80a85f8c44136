#include "anigen/nn/kernels/mixed_products.h"

#include <algorithm>
#include <atomic>
#include <cstdlib>
#include <cstring>

#include "anigen/nn/kernels/bf16_products.h"
#include "anigen/nn/kernels/tiles.h"

namespace anigen::nn {

namespace {

std::atomic<MixedForm> asked{MixedForm::kNone};

}  // namespace

bool mixed_products() {
  const MixedForm form = asked;
  return form == MixedForm::kEmulated || (form == MixedForm::kKernels && kernels::has_bf16_products());
}

bool emulated_mixed_products() { return asked == MixedForm::kEmulated; }

void set_mixed_products(MixedForm form) { asked = form; }

MixedProducts::MixedProducts(MixedForm form) : before_(asked) { asked = form; }

MixedProducts::~MixedProducts() { asked = before_; }

}  // namespace anigen::nn

namespace anigen::nn::kernels {

ANIGEN_KERNEL(void, round_values, (float* __restrict values, std::int64_t count), (values, count)) {
  for (std::int64_t i = 0; i < count; ++i) {
    std::uint32_t bits = 0;
    std::memcpy(&bits, values + i, sizeof bits);
    const bool is_nan = (bits & 0x7FFFFFFFU) > 0x7F800000U;  // whose bits would overflow
    const std::uint32_t nearest = (bits + 0x7FFFU + ((bits >> 16U) & 1U)) & 0xFFFF0000U;
    bits = is_nan ? bits : nearest;
    std::memcpy(values + i, &bits, sizeof bits);
  }
}

void round_in_place(float* values, std::int64_t count) { round_values(values, count); }

#if ANIGEN_BF16_X86

namespace {

constexpr std::int64_t kPanelColumns = 64;  // of packed weights: four vectors
constexpr std::int64_t kDepth = 256;        // of a panel at a time: 32 KiB, which stay in the first-level cache

// Of a correlation: rows of a block, channels of `in` and columns of `out` that are interleaved at a time. A tile is
// eight rows by two vectors of sums.
constexpr std::int64_t kBlock = 128, kSteps = kBlock / 2, kChannels = 128, kTileRows = 8, kTileVectors = 2;
constexpr std::int64_t kTileColumns = kTileVectors * kBf16Lanes;

ANIGEN_BF16_BEGIN

ANIGEN_BF16_INLINE __mmask16 first_lanes(std::int64_t count) {
  return static_cast<__mmask16>(count >= kBf16Lanes ? 0xFFFF : (1 << count) - 1);
}

// Sixteen channels from `channel` on of rows 2 p and 2 p + 1 of a block; a missing one counts as zeros.
ANIGEN_BF16_INLINE __m512i interleaved_rows(const ListedRows& rows, std::int64_t p, std::int64_t first,
                                            std::int64_t count, std::int64_t channel, std::int64_t channels) {
  const __mmask16 lanes = first_lanes(channels - channel);
  const __m512 even = _mm512_maskz_loadu_ps(lanes, rows.row(first + 2 * p) + channel);
  const __m512 odd =
      2 * p + 1 < count ? _mm512_maskz_loadu_ps(lanes, rows.row(first + 2 * p + 1) + channel) : _mm512_setzero_ps();
  return interleaved(even, odd);
}

// sums[r, :] += Σ_p x[p, r] · y[p, :] of pairs, for a tile. @param x [steps, 8] words @param y [steps, 16 kVectors]
template <int kVectors>
ANIGEN_BF16_INLINE void correlate_tile(const std::uint32_t* x, const std::uint32_t* y, std::int64_t steps, float* sums,
                                       std::int64_t stride, std::int64_t rows) {
  __m512 tile[kTileRows][kVectors];
#pragma GCC unroll 8
  for (int r = 0; r < kTileRows; ++r) {
#pragma GCC unroll 2
    for (int v = 0; v < kVectors; ++v)
      tile[r][v] = r < rows ? _mm512_loadu_ps(sums + r * stride + v * kBf16Lanes) : _mm512_setzero_ps();
  }
  for (std::int64_t p = 0; p < steps; ++p, x += kTileRows, y += kTileColumns) {
    __m512bh columns[kVectors];
#pragma GCC unroll 2
    for (int v = 0; v < kVectors; ++v) columns[v] = reinterpret_cast<__m512bh>(_mm512_load_si512(y + v * kBf16Lanes));
#pragma GCC unroll 8
    for (int r = 0; r < kTileRows; ++r) {
      const __m512bh factor = reinterpret_cast<__m512bh>(_mm512_set1_epi32(static_cast<int>(x[r])));
#pragma GCC unroll 2
      for (int v = 0; v < kVectors; ++v) tile[r][v] = _mm512_dpbf16_ps(tile[r][v], factor, columns[v]);
    }
  }
#pragma GCC unroll 8
  for (int r = 0; r < kTileRows; ++r) {
    if (r >= rows) break;
#pragma GCC unroll 2
    for (int v = 0; v < kVectors; ++v) _mm512_storeu_ps(sums + r * stride + v * kBf16Lanes, tile[r][v]);
  }
}

}  // namespace

ANIGEN_BF16 void round_to_bf16(const float* values, std::int64_t count, std::uint16_t* rounded) {
  std::int64_t i = 0;
  for (; i + 2 * kBf16Lanes <= count; i += 2 * kBf16Lanes) {
    const __m512 low = _mm512_loadu_ps(values + i), high = _mm512_loadu_ps(values + i + kBf16Lanes);
    _mm512_storeu_si512(rounded + i, reinterpret_cast<__m512i>(_mm512_cvtne2ps_pbh(high, low)));
  }
  for (; i < count; i += kBf16Lanes) {
    const __mmask16 lanes = first_lanes(count - i);
    const __m256bh some = _mm512_cvtneps_pbh(_mm512_maskz_loadu_ps(lanes, values + i));
    _mm256_mask_storeu_epi16(rounded + i, lanes, reinterpret_cast<__m256i>(some));
  }
}

ANIGEN_BF16 void pack_mixed(const StridedMatrix& matrix, std::int64_t depth, std::int64_t columns,
                            std::uint16_t* packed) {
  float even[kBf16Lanes], odd[kBf16Lanes];
  for (std::int64_t first = 0; first < columns; first += kPanelColumns) {
    const std::int64_t width = std::min(kPanelColumns, columns - first);
    for (std::int64_t k = 0; k < depth; k += 2) {
      for (std::int64_t c = 0; c < width; c += kBf16Lanes, packed += 2 * kBf16Lanes) {
        const float* from = matrix.values + k * matrix.row + (first + c) * matrix.column;
        for (std::int64_t i = 0; i < kBf16Lanes; ++i, from += matrix.column) {
          even[i] = from[0];
          odd[i] = from[matrix.row];
        }
        _mm512_storeu_si512(packed, interleaved(_mm512_loadu_ps(even), _mm512_loadu_ps(odd)));
      }
    }
  }
}

void multiply_mixed(const std::uint16_t* in, const std::uint16_t* packed, std::int64_t rows, std::int64_t depth,
                    std::int64_t columns, float* out) {
  Bf16Multiplier multiplier;
  for (std::int64_t first = 0; first < columns; first += kPanelColumns, packed += depth * kPanelColumns) {
    const std::int64_t vectors = std::min(kPanelColumns, columns - first) / kBf16Lanes;
    for (std::int64_t k = 0; k < depth; k += kDepth) {
      multiplier.multiply({in + k, depth, packed + k * vectors * kBf16Lanes, out + first, columns, rows,
                           std::min(kDepth, depth - k) / 2, vectors},
                          /*adds=*/true);
    }
  }
}

ANIGEN_BF16 void correlate_mixed(const ListedRows& in, const ListedRows& out, std::int64_t count,
                                 std::int64_t in_channels, std::int64_t out_channels, float* sums,
                                 std::int64_t stride) {
  alignas(64) std::uint32_t x[kChannels * kSteps];     // [tile, step, row of the tile]
  alignas(64) std::uint32_t y[kTileColumns * kSteps];  // [step, column of the tile]
  for (std::int64_t first = 0; first < count; first += kBlock) {
    const std::int64_t block = std::min(kBlock, count - first), steps = (block + 1) / 2;
    for (std::int64_t c = 0; c < in_channels; c += kChannels) {
      const std::int64_t channels = std::min(kChannels, in_channels - c);
      for (std::int64_t p = 0; p < steps; ++p) {
        for (std::int64_t k = 0; k < channels; k += kBf16Lanes) {
          const __m512i words = interleaved_rows(in, p, first, block, c + k, in_channels);
          std::uint32_t* tile = x + (k * kSteps + p * kTileRows);
          _mm256_store_si256(reinterpret_cast<__m256i*>(tile), _mm512_castsi512_si256(words));
          _mm256_store_si256(reinterpret_cast<__m256i*>(tile + kTileRows * kSteps),
                             _mm512_extracti64x4_epi64(words, 1));
        }
      }
      for (std::int64_t column = 0; column < out_channels; column += kTileColumns) {
        const bool wide = out_channels - column > kBf16Lanes;
        for (std::int64_t p = 0; p < steps; ++p) {
          for (std::int64_t v = 0; v < (wide ? kTileVectors : 1); ++v) {
            const std::int64_t from = column + v * kBf16Lanes;
            _mm512_store_si512(y + p * kTileColumns + v * kBf16Lanes,
                               interleaved_rows(out, p, first, block, from, out_channels));
          }
        }
        for (std::int64_t k = 0; k < channels; k += kTileRows) {
          float* to = sums + (c + k) * stride + column;
          const std::int64_t rows = std::min(kTileRows, channels - k);
          if (wide) {
            correlate_tile<kTileVectors>(x + k * kSteps, y, steps, to, stride, rows);
          } else {
            correlate_tile<1>(x + k * kSteps, y, steps, to, stride, rows);
          }
        }
      }
    }
  }
}

ANIGEN_BF16_END

#else

void round_to_bf16(const float*, std::int64_t, std::uint16_t*) { std::abort(); }  // has_bf16_products() said no
void pack_mixed(const StridedMatrix&, std::int64_t, std::int64_t, std::uint16_t*) { std::abort(); }
void multiply_mixed(const std::uint16_t*, const std::uint16_t*, std::int64_t, std::int64_t, std::int64_t, float*) {
  std::abort();
}
void correlate_mixed(const ListedRows&, const ListedRows&, std::int64_t, std::int64_t, std::int64_t, float*,
                     std::int64_t) {
  std::abort();
}

#endif

}  // namespace anigen::nn::kernels
