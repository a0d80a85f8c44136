#pragma once
#include <cstdint>
#include <cstring>

#include "anigen/core/kernel_form.h"

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

namespace anigen::nn::kernels {

/// True if kernels multiply pairs of bf16 numbers: this CPU does, and ANIGEN_KERNELS asks for nothing narrower.
inline bool has_bf16_products() { return kernel_form() >= KernelForm::kAvx512Bf16; }

inline constexpr std::int64_t kBf16Lanes = 16;  ///< fp32 numbers of a vector
inline constexpr int kBf16TileRows = 6;         ///< 6 x 4 vectors of sums, 4 of factors: 28 of 32 registers

inline constexpr std::int64_t kBf16AskingPairs = 8;

/// For products that ask for nothing (nn/rows_ahead.h).
struct NothingAhead {
  void ask() {}
};

#if ANIGEN_BF16_X86
#define ANIGEN_BF16 __attribute__((target("avx512f,avx512bw,avx512vl,avx512dq,avx512bf16")))
#define ANIGEN_BF16_INLINE ANIGEN_BF16 inline __attribute__((always_inline))
// GCC 12 takes the don't-care operands of its own intrinsics for variables without a value.
#define ANIGEN_BF16_BEGIN                                                                    \
  _Pragma("GCC diagnostic push") _Pragma("GCC diagnostic ignored \"-Wmaybe-uninitialized\"") \
      _Pragma("GCC diagnostic ignored \"-Wuninitialized\"")
#define ANIGEN_BF16_END _Pragma("GCC diagnostic pop")

ANIGEN_BF16_BEGIN

/// sums(r)[:] (+)= Σ_p factors(r)[2p] b[p, :, 0] + factors(r)[2p + 1] b[p, :, 1] for kRows rows and kVectors · 16
/// columns. @param factors, sums row → its first number @param b [pairs, columns, 2] @param ahead asked every
/// kBf16AskingPairs pairs
template <int kRows, int kVectors, bool kAdd, typename FactorRow, typename SumRow, typename Ahead>
ANIGEN_BF16_INLINE void bf16_tile(const FactorRow& factors, const SumRow& sums, std::int64_t pairs,
                                  const std::uint16_t* b, Ahead& ahead) {
  const std::uint16_t* rows[kRows];
  __m512 tile[kRows][kVectors];
#pragma GCC unroll 8
  for (int r = 0; r < kRows; ++r) {
    rows[r] = factors(r);
#pragma GCC unroll 4
    for (int v = 0; v < kVectors; ++v) {
      tile[r][v] = kAdd ? _mm512_loadu_ps(sums(r) + v * kBf16Lanes) : _mm512_setzero_ps();
    }
  }
  for (std::int64_t p = 0; p < pairs; ++p, b += 2 * kBf16Lanes * kVectors) {
    if (p % kBf16AskingPairs == 0) ahead.ask();
    __m512bh columns[kVectors];
#pragma GCC unroll 4
    for (int v = 0; v < kVectors; ++v) {
      columns[v] = reinterpret_cast<__m512bh>(_mm512_loadu_si512(b + 2 * kBf16Lanes * v));
    }
#pragma GCC unroll 8
    for (int r = 0; r < kRows; ++r) {
      std::int32_t pair;
      std::memcpy(&pair, rows[r] + 2 * p, sizeof pair);
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
                                  const std::uint16_t* b, Ahead&& ahead) {
  std::int64_t first = 0;
  const auto from = [&](int r) { return factors(first + r); };
  const auto to = [&](int r) { return sums(first + r); };
  for (; first + kBf16TileRows <= rows; first += kBf16TileRows) {
    bf16_tile<kBf16TileRows, kVectors, kAdd>(from, to, pairs, b, ahead);
  }
  switch (rows - first) {
    case 1:
      return bf16_tile<1, kVectors, kAdd>(from, to, pairs, b, ahead);
    case 2:
      return bf16_tile<2, kVectors, kAdd>(from, to, pairs, b, ahead);
    case 3:
      return bf16_tile<3, kVectors, kAdd>(from, to, pairs, b, ahead);
    case 4:
      return bf16_tile<4, kVectors, kAdd>(from, to, pairs, b, ahead);
    case 5:
      return bf16_tile<5, kVectors, kAdd>(from, to, pairs, b, ahead);
    default:
      return;
  }
}

ANIGEN_BF16_END
#endif

}  // namespace anigen::nn::kernels
