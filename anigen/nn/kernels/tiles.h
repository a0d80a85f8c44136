#pragma once
#include <algorithm>
#include <cstdint>
#include <cstring>

#include "anigen/core/kernel_form.h"
#include "anigen/nn/torch.h"

/// Products of bf16 matrices on CPUs with AVX512-BF16, which add up pairs of exact products in fp32. Included by
/// sources of kernels only. Everything but has_bf16_products() must be called from functions marked ANIGEN_BF16, and
/// only where that says so; ANIGEN_BF16_X86 is 0 where the compiler knows no such CPU. bf16 numbers are passed as their
/// 16 bits.
#if defined(__x86_64__) && defined(__GNUC__)
#define ANIGEN_BF16_X86 1
#include <immintrin.h>
#else
#define ANIGEN_BF16_X86 0
#endif

/// For sources with loops over arrays of floats: functions are defined by ANIGEN_KERNEL, and what they call in their
/// loops is marked so.
#define ANIGEN_INLINE ANIGEN_KERNEL_INLINE

/// Products of matrices that stay in the cache, such as the queries and keys of one window and head, where starting a
/// product of a library costs as much as the product. fp32, one thread, no allocation.

namespace anigen::nn {

/// The values of a bf16 tensor as their 16 bits, as the kernels for bf16 take them.
inline std::uint16_t* bf16_bits(const Tensor& x) {
  return reinterpret_cast<std::uint16_t*>(x.data_ptr<at::BFloat16>());
}

}  // namespace anigen::nn

namespace anigen::nn::kernels {

/// True if kernels multiply pairs of bf16 numbers: this CPU does, and ANIGEN_KERNELS asks for nothing narrower.
inline bool has_bf16_products() { return kernel_form() >= KernelForm::kAvx512Bf16; }

inline constexpr std::int64_t kBf16Lanes = 16;  ///< fp32 numbers of a vector
inline constexpr int kBf16TileRows = 6;         ///< 6 x 4 vectors of sums, 4 of factors: 28 of 32 registers

inline constexpr std::int64_t kBf16AskingPairs = 8;

/// For products that ask for nothing (nn/kernels/tiles.h).
struct NothingAhead {
  void ask() {}
};

#if ANIGEN_BF16_X86
#define ANIGEN_BF16 __attribute__((target("avx512f,avx512bw,avx512vl,avx512dq,avx512bf16")))
#define ANIGEN_BF16_INLINE ANIGEN_BF16 inline __attribute__((always_inline))
#ifdef __clang__
#define ANIGEN_BF16_BEGIN
#define ANIGEN_BF16_END
#else
// GCC 12 takes the don't-care operands of its own intrinsics for variables without a value.
#define ANIGEN_BF16_BEGIN                                                                    \
  _Pragma("GCC diagnostic push") _Pragma("GCC diagnostic ignored \"-Wmaybe-uninitialized\"") \
      _Pragma("GCC diagnostic ignored \"-Wuninitialized\"")
#define ANIGEN_BF16_END _Pragma("GCC diagnostic pop")
#endif

ANIGEN_BF16_BEGIN

/// sums(r)[:] (+)= Σ_p factors(r)[2p] b[p, :, 0] + factors(r)[2p + 1] b[p, :, 1] for kRows rows and kVectors · 16
/// columns. @param factors, sums row → its first number @param b [pairs, columns, 2] @param ahead asked every
/// kBf16AskingPairs pairs @param step numbers from one pair of a row of factors to the next, 2 where a row is dense
template <int kRows, int kVectors, bool kAdd, typename FactorRow, typename SumRow, typename Ahead>
ANIGEN_BF16_INLINE void bf16_tile(const FactorRow& factors, const SumRow& sums, std::int64_t pairs,
                                  const std::uint16_t* b, Ahead& ahead, std::int64_t step) {
  const std::uint16_t* rows[kRows];
  __m512 tile[kRows][kVectors];
#pragma GCC unroll 8
  for (int r = 0; r < kRows; ++r) {
    rows[r] = factors(r);
#pragma GCC unroll 4
    for (int v = 0; v < kVectors; ++v)
      tile[r][v] = kAdd ? _mm512_loadu_ps(sums(r) + v * kBf16Lanes) : _mm512_setzero_ps();
  }
  for (std::int64_t p = 0; p < pairs; ++p, b += 2 * kBf16Lanes * kVectors) {
    if (p % kBf16AskingPairs == 0) ahead.ask();
    __m512bh columns[kVectors];
#pragma GCC unroll 4
    for (int v = 0; v < kVectors; ++v)
      columns[v] = reinterpret_cast<__m512bh>(_mm512_loadu_si512(b + 2 * kBf16Lanes * v));
#pragma GCC unroll 8
    for (int r = 0; r < kRows; ++r) {
      std::int32_t pair;
      std::memcpy(&pair, rows[r] + step * p, sizeof pair);
      const __m512bh factor = reinterpret_cast<__m512bh>(_mm512_set1_epi32(pair));
#pragma GCC unroll 4
      for (int v = 0; v < kVectors; ++v) tile[r][v] = _mm512_dpbf16_ps(tile[r][v], factor, columns[v]);
    }
  }
#pragma GCC unroll 8
  for (int r = 0; r < kRows; ++r) {
#pragma GCC unroll 4
    for (int v = 0; v < kVectors; ++v) _mm512_storeu_ps(sums(r) + v * kBf16Lanes, tile[r][v]);
  }
}

/// Rows 0 … rows of the same in tiles of kBf16TileRows, the last ones in one smaller tile: row by row the processor
/// would wait for its own sums.
template <int kVectors, bool kAdd, typename FactorRow, typename SumRow, typename Ahead>
ANIGEN_BF16_INLINE void bf16_rows(const FactorRow& factors, const SumRow& sums, std::int64_t rows, std::int64_t pairs,
                                  const std::uint16_t* b, Ahead&& ahead, std::int64_t step = 2) {
  std::int64_t first = 0;
  const auto from = [&](int r) { return factors(first + r); };
  const auto to = [&](int r) { return sums(first + r); };
  for (; first + kBf16TileRows <= rows; first += kBf16TileRows)
    bf16_tile<kBf16TileRows, kVectors, kAdd>(from, to, pairs, b, ahead, step);
  switch (rows - first) {
    case 1:
      return bf16_tile<1, kVectors, kAdd>(from, to, pairs, b, ahead, step);
    case 2:
      return bf16_tile<2, kVectors, kAdd>(from, to, pairs, b, ahead, step);
    case 3:
      return bf16_tile<3, kVectors, kAdd>(from, to, pairs, b, ahead, step);
    case 4:
      return bf16_tile<4, kVectors, kAdd>(from, to, pairs, b, ahead, step);
    case 5:
      return bf16_tile<5, kVectors, kAdd>(from, to, pairs, b, ahead, step);
    default:
      return;
  }
}

/// e^t, 0 below -87, NaN for NaN and +inf; coefficients of Cephes' expf.
ANIGEN_BF16_INLINE __m512 exp_vector(__m512 t) {
  t = _mm512_max_ps(_mm512_set1_ps(-87.0F), t);  // returns the second for NaN
  const __m512 n = _mm512_roundscale_ps(_mm512_mul_ps(t, _mm512_set1_ps(1.44269504088896341F)), 8);
  __m512 r = _mm512_fnmadd_ps(n, _mm512_set1_ps(0.693359375F), t);
  r = _mm512_fnmadd_ps(n, _mm512_set1_ps(-2.12194440e-4F), r);
  __m512 p = _mm512_set1_ps(1.9875691500e-4F);
  p = _mm512_fmadd_ps(p, r, _mm512_set1_ps(1.3981999507e-3F));
  p = _mm512_fmadd_ps(p, r, _mm512_set1_ps(8.3334519073e-3F));
  p = _mm512_fmadd_ps(p, r, _mm512_set1_ps(4.1665795894e-2F));
  p = _mm512_fmadd_ps(p, r, _mm512_set1_ps(1.6666665459e-1F));
  p = _mm512_fmadd_ps(p, r, _mm512_set1_ps(5.0000001201e-1F));
  p = _mm512_fmadd_ps(p, _mm512_mul_ps(r, r), _mm512_add_ps(r, _mm512_set1_ps(1.0F)));
  return _mm512_scalef_ps(p, n);
}

/// Sixteen words: the bf16 numbers of `a` in their lower, those of `b` in their upper halves.
ANIGEN_BF16_INLINE __m512i interleaved(__m512 a, __m512 b) {
  const __m512i order = _mm512_set_epi16(31, 15, 30, 14, 29, 13, 28, 12, 27, 11, 26, 10, 25, 9, 24, 8, 23, 7, 22, 6, 21,
                                         5, 20, 4, 19, 3, 18, 2, 17, 1, 16, 0);
  return _mm512_permutexvar_epi16(order, reinterpret_cast<__m512i>(_mm512_cvtne2ps_pbh(b, a)));
}

ANIGEN_BF16_END
#endif

template <typename To, typename From>
ANIGEN_INLINE To bits_as(From from) {
  static_assert(sizeof(To) == sizeof(From), "same size");
  To to;
  std::memcpy(&to, &from, sizeof to);
  return to;
}

/// e^t to about one unit in the last place for |t| <= 87. Nothing but arithmetic, so that loops over it are vectorised:
/// t = n ln 2 + r with |r| <= ln 2 / 2, and a polynomial for e^r (coefficients of Cephes' expf).
ANIGEN_INLINE float exp_within_87(float t) {
  constexpr float kShifter = 12582912.0F;  // 1.5 · 2^23: adding it leaves the nearest integer in the low bits
  const float shifted = t * 1.44269504088896341F + kShifter;
  const float n = shifted - kShifter;
  const float r = (t - n * 0.693359375F) - n * -2.12194440e-4F;  // ln 2 in two parts
  float p = 1.9875691500e-4F;
  p = p * r + 1.3981999507e-3F;
  p = p * r + 8.3334519073e-3F;
  p = p * r + 4.1665795894e-2F;
  p = p * r + 1.6666665459e-1F;
  p = p * r + 5.0000001201e-1F;
  p = p * (r * r) + r + 1.0F;
  const auto power = (bits_as<std::uint32_t>(shifted) << 23) + 0x3F800000U;  // the bits of 2^n
  return p * bits_as<float>(power);
}

/// e^t, clamped beyond |t| = 87 (and for NaN). The clamp works on the bits, since compilers do not vectorise
/// comparisons of floats, which might trap.
ANIGEN_INLINE float exp_clamped(float t) {
  const auto bits = bits_as<std::int32_t>(t);
  constexpr std::int32_t kBitsOf87 = 0x42AE0000, kMagnitude = 0x7FFFFFFF;
  const std::int32_t magnitude = bits & kMagnitude;
  const std::int32_t clamped = magnitude < kBitsOf87 ? magnitude : kBitsOf87;
  return exp_within_87(bits_as<float>(clamped | (bits & ~kMagnitude)));
}

/// As above, for t <= 0 with fewer operations. Anything for NaN.
ANIGEN_INLINE float exp_up_to_0(float t) {
  const auto bits = bits_as<std::uint32_t>(t);
  constexpr std::uint32_t kBitsOfMinus87 = 0xC2AE0000U;
  return exp_within_87(bits_as<float>(bits < kBitsOfMinus87 ? bits : kBitsOfMinus87));
}

/// exp_clamped, but NaN for NaN and infinities.
ANIGEN_INLINE float exp_or_nan(float t) { return exp_clamped(t) + 0.0F * t; }

}  // namespace anigen::nn::kernels

namespace anigen::nn::products {

/// Rows in memory that the thread reads or writes soon, asked for a few at a time while it computes: rows of one head
/// lie a page apart, where no processor guesses the next one. Only a hint: the rows are neither read nor changed.
class RowsAhead {
 public:
  /// `count` rows of `bytes`, `stride` bytes apart. Up to kRanges of them; more are left out.
  void add(const void* first, std::int64_t count, std::int64_t stride, std::int64_t bytes) {
    if (ranges_ == kRanges || count == 0) return;
    ranges_of_[ranges_++] = {static_cast<const char*>(first), stride, bytes, count};
    left_ += count;
  }

  /// Spreads all rows over so many calls of ask().
  void spread_over(std::int64_t calls) { pace_ = (left_ + calls - 1) / std::max<std::int64_t>(calls, 1); }

  ANIGEN_INLINE void ask() {
    for (std::int64_t i = std::min(pace_, left_); i > 0; --i, --left_) {
      Range& range = ranges_of_[current_];
      for (std::int64_t b = 0; b < range.bytes; b += kCacheLine) __builtin_prefetch(range.row + b);
      range.row += range.stride;
      if (--range.count == 0) ++current_;
    }
  }

  /// Rows not asked for yet.
  std::int64_t left() const { return left_; }

 private:
  struct Range {
    const char* row;
    std::int64_t stride, bytes, count;
  };
  static constexpr int kRanges = 8;
  static constexpr std::int64_t kCacheLine = 64;

  Range ranges_of_[kRanges] = {};
  int ranges_ = 0, current_ = 0;
  std::int64_t left_ = 0, pace_ = 0;
};

/// Columns that are handled at a time: the rows of `right` and `out` below have space for a multiple of it.
inline constexpr std::int64_t kLanes = 16;

/// The next multiple of kLanes.
inline std::int64_t padded(std::int64_t columns) { return (columns + kLanes - 1) / kLanes * kLanes; }

/// A distance between rows with space for so many columns: an odd number of cache lines, so that a column of the matrix
/// does not fall into few sets of the cache.
inline std::int64_t spread_stride(std::int64_t columns) { return padded(columns) | kLanes; }

/// A factor whose values may be anywhere: (r, c) is values[r · row + c · column].
struct Factor {
  const float* values;
  std::int64_t row, column;
};

/// A matrix whose rows are `stride` values apart.
struct Block {
  float* values;
  std::int64_t stride;

  Factor plain() const { return {values, stride, 1}; }
  Factor transposed() const { return {values, 1, stride}; }
  Block from_row(std::int64_t row) const { return {values + row * stride, stride}; }
};

struct ProductSize {
  std::int64_t rows, columns, depth;
};

/// out = left right, or out += left right. Columns up to the next multiple of kLanes are read in `right` and written in
/// `out`. A row of the result does not depend on how many rows there are.
/// @param left [rows, depth] @param right [depth, columns] @param out [rows, columns], apart from both
/// @param ahead asked at least asking_calls(size) times, evenly over the product
void multiply(const ProductSize& size, const Factor& left, const Block& right, const Block& out, bool accumulate,
              RowsAhead& ahead);
void multiply(const ProductSize& size, const Factor& left, const Block& right, const Block& out, bool accumulate);

std::int64_t asking_calls(const ProductSize& size);

/// out(c, r) = in(r, c). @param rows, columns multiples of 4
void transpose(std::int64_t rows, std::int64_t columns, const Block& in, const Block& out);

}  // namespace anigen::nn::products

namespace anigen::nn::kernels {

/// Integers in the order of the floats with these bits; its own inverse. Compilers vectorise the maximum of integers,
/// but not that of floats, which has rules for NaN.
ANIGEN_INLINE std::int32_t ordered_bits(std::int32_t bits) { return bits ^ ((bits >> 31) & 0x7FFFFFFF); }

/// The largest of a row of scores and `start`.
ANIGEN_INLINE float largest_score(const float* row, std::int64_t n, float start) {
  std::int32_t largest = ordered_bits(bits_as<std::int32_t>(start));
  for (std::int64_t c = 0; c < n; ++c) {
    const std::int32_t key = ordered_bits(bits_as<std::int32_t>(row[c]));
    largest = largest > key ? largest : key;
  }
  return bits_as<float>(ordered_bits(largest));
}

struct ScoreRange {
  float smallest, largest;
};

/// The smallest and the largest of a row of scores, the largest of `start` as well. NaN and infinities come out of it:
/// negative NaN is the smallest of all, positive NaN the largest.
ANIGEN_INLINE ScoreRange score_range(const float* row, std::int64_t n, float start) {
  std::int32_t smallest = 0x7FFFFFFF, largest = ordered_bits(bits_as<std::int32_t>(start));
  for (std::int64_t c = 0; c < n; ++c) {
    const std::int32_t key = ordered_bits(bits_as<std::int32_t>(row[c]));
    smallest = smallest < key ? smallest : key;
    largest = largest > key ? largest : key;
  }
  return {bits_as<float>(ordered_bits(smallest)), bits_as<float>(ordered_bits(largest))};
}

}  // namespace anigen::nn::kernels
