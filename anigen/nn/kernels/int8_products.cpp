#include "anigen/nn/kernels/int8_products.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <limits>

#include "anigen/core/kernel_form.h"
#include "anigen/nn/kernels/rows.h"

#if defined(__x86_64__) && defined(__GNUC__)
#define ANIGEN_INT8_X86 1
#include <immintrin.h>
#define ANIGEN_VNNI __attribute__((target("avx512f,avx512bw,avx512vl,avx512vnni")))
#define ANIGEN_VNNI_INLINE ANIGEN_VNNI inline __attribute__((always_inline))
#else
#define ANIGEN_INT8_X86 0
#endif

namespace anigen::nn::kernels {

namespace {

constexpr float kInt8Largest = 127.0F;
constexpr int kInt8Middle = 128;  // added to the integers of rows, which are multiplied without a sign
constexpr std::int64_t kQuad = 4;

// Scale of integers that stand for numbers up to `largest`.
float int8_scale(float largest) { return largest / kInt8Largest; }

float largest_of(const float* values, std::int64_t count) {
  float largest = 0.0F;
  for (std::int64_t i = 0; i < count; ++i) largest = std::max(largest, std::abs(values[i]));
  return largest;
}

// All numbers are integer multiples of the scale, up to the rounding of a stored product.
bool are_multiples(const float* values, std::int64_t count, float scale) {
  constexpr float kOff = 1e-3F;
  for (std::int64_t i = 0; i < count; ++i) {
    const float q = values[i] / scale;
    if (std::abs(q - std::nearbyint(q)) > kOff) return false;
  }
  return true;
}

// Place of number k of a column in Int8Matrix::values.
std::size_t place(const Int8Matrix& matrix, std::int64_t column, std::int64_t k) {
  const std::int64_t depth = matrix.groups() * kInt8Group;
  const std::int64_t panel = column / kInt8PanelColumns, within = column % kInt8PanelColumns;
  return static_cast<std::size_t>(panel * kInt8PanelColumns * depth + k / kQuad * kQuad * kInt8PanelColumns +
                                  within * kQuad + k % kQuad);
}

// out[r, c] (+)= scale[r] · scale[c] · Σ_k x[r, k] w[k, c] of one group, integers as fp32: their sums stay below 2^24.
ANIGEN_KERNEL(void, wide_group,
              (const std::uint8_t* x, const float* x_scales, std::int64_t rows, const std::int8_t* w,
               const float* w_scales, bool adds, float* out),
              (x, x_scales, rows, w, w_scales, adds, out)) {
  alignas(64) float wide[kInt8Group * kInt8PanelColumns];
  for (std::int64_t k = 0; k < kInt8Group; ++k) {
    const std::int8_t* from = w + k / kQuad * kQuad * kInt8PanelColumns + k % kQuad;
    for (std::int64_t c = 0; c < kInt8PanelColumns; ++c)
      wide[k * kInt8PanelColumns + c] = static_cast<float>(from[c * kQuad]);
  }
  for (std::int64_t r = 0; r < rows; ++r) {
    alignas(64) float sums[kInt8PanelColumns] = {};
    for (std::int64_t k = 0; k < kInt8Group; ++k) {
      const auto factor = static_cast<float>(static_cast<int>(x[r * kInt8Group + k]) - kInt8Middle);
      for (std::int64_t c = 0; c < kInt8PanelColumns; ++c) sums[c] += factor * wide[k * kInt8PanelColumns + c];
    }
    float* to = out + r * kInt8PanelColumns;
    for (std::int64_t c = 0; c < kInt8PanelColumns; ++c) {
      const float value = sums[c] * (w_scales[c] * x_scales[r]);
      to[c] = adds ? to[c] + value : value;
    }
  }
}

// One group of a row; what is missing of it gets the integer of 0.
template <typename Number>
ANIGEN_INLINE void round_group(const Number* x, std::int64_t count, std::uint8_t* values, float& scale) {
  alignas(64) float scratch[kInt8Group];
  const float* wide = widened(x, count, scratch);
  // Floats without their signs are ordered as their bits, and compilers reorder a largest integer.
  constexpr std::int32_t kWithoutSign = 0x7FFFFFFF, kInfinity = 0x7F800000;
  std::int32_t largest_bits = 0;
  for (std::int64_t i = 0; i < count; ++i) {
    const std::int32_t bits = bits_as<std::int32_t>(wide[i]) & kWithoutSign;
    largest_bits = bits > largest_bits ? bits : largest_bits;
  }
  const auto largest = bits_as<float>(largest_bits);
  float factor = 0.0F;
  scale = largest_bits < kInfinity ? 0.0F : std::numeric_limits<float>::quiet_NaN();
  if (largest >= kSmallestInt8 && largest_bits < kInfinity) {
    factor = kInt8Largest / largest;
    scale = int8_scale(largest);
  }
  for (std::int64_t i = 0; i < count; ++i) {
    // The magic number's last bit is 1: adding it rounds to the nearest integer, ties to even.
    constexpr float kMagic = 12582912.0F;
    constexpr std::uint32_t kMiddle = kInt8Middle;
    values[i] = static_cast<std::uint8_t>(bits_as<std::uint32_t>(wide[i] * factor + kMagic) + kMiddle);
  }
  for (std::int64_t i = count; i < kInt8Group; ++i) values[i] = static_cast<std::uint8_t>(kInt8Middle);
}

// Those that begin at x of all rows.
template <typename Number>
ANIGEN_INLINE void round_groups_of(const Number* x, std::int64_t rows, std::int64_t count, std::int64_t stride,
                                   std::uint8_t* values, float* scales) {
  for (std::int64_t r = 0; r < rows; ++r) {
    if (count == kInt8Group) {
      round_group(x + r * stride, kInt8Group, values + r * kInt8Group, scales[r]);
    } else {
      round_group(x + r * stride, count, values + r * kInt8Group, scales[r]);
    }
  }
}

ANIGEN_KERNEL(void, round_groups,
              (const float* x, std::int64_t rows, std::int64_t count, std::int64_t stride, std::uint8_t* values,
               float* scales),
              (x, rows, count, stride, values, scales)) {
  round_groups_of(x, rows, count, stride, values, scales);
}

ANIGEN_KERNEL(void, round_bf16_groups,
              (const std::uint16_t* x, std::int64_t rows, std::int64_t count, std::int64_t stride, std::uint8_t* values,
               float* scales),
              (x, rows, count, stride, values, scales)) {
  round_groups_of(x, rows, count, stride, values, scales);
}

template <typename Number, typename RoundGroups>
void round_all_groups(const Number* x, std::int64_t rows, std::int64_t depth, std::int64_t stride, Int8Rows& rounded,
                      const RoundGroups& round) {
  const std::int64_t groups = (depth + kInt8Group - 1) / kInt8Group;
  rounded.values.resize(static_cast<std::size_t>(groups * rows * kInt8Group));
  rounded.scales.resize(static_cast<std::size_t>(groups * rows));
  for (std::int64_t g = 0; g < groups; ++g) {
    const std::int64_t first = g * kInt8Group;
    round(x + first, rows, std::min(kInt8Group, depth - first), stride, rounded.values.data() + g * rows * kInt8Group,
          rounded.scales.data() + g * rows);
  }
}

template <typename Number>
ANIGEN_INLINE void add_bias(const float* panel, std::int64_t rows, std::int64_t columns, const float* bias, Number* out,
                            std::int64_t stride) {
  for (std::int64_t r = 0; r < rows; ++r, panel += kInt8PanelColumns, out += stride) {
    alignas(64) float scratch[kInt8PanelColumns];
    float* const wide = wide_row(out, scratch);
    for (std::int64_t c = 0; c < columns; ++c) wide[c] = panel[c] + bias[c];
    round_row(wide, columns, out);
  }
}

#if ANIGEN_INT8_X86

constexpr std::int64_t kQuadLanes = 16;
constexpr int kQuadVectors = 4, kQuadRows = 6;  // 24 sums, 4 of factors: 29 of 32 registers
static_assert(kInt8PanelColumns == kQuadLanes * kQuadVectors);

// GCC 12 takes the don't-care operands of its own intrinsics for variables without a value.
#pragma GCC diagnostic push
#ifndef __clang__
#pragma GCC diagnostic ignored "-Wmaybe-uninitialized"
#endif
#pragma GCC diagnostic ignored "-Wuninitialized"

// wide_group() for kRows rows, four integers at a time.
template <int kRows>
ANIGEN_VNNI_INLINE void quad_tile(const std::uint8_t* x, const float* x_scales, const std::int8_t* w,
                                  const float* w_scales, const std::int32_t* starts, bool adds, float* out) {
  __m512i sums[kRows][kQuadVectors];
#pragma GCC unroll 4
  for (int v = 0; v < kQuadVectors; ++v) {
    const __m512i start = _mm512_loadu_si512(starts + v * kQuadLanes);
#pragma GCC unroll 8
    for (int r = 0; r < kRows; ++r) sums[r][v] = start;
  }
  for (std::int64_t k = 0; k < kInt8Group; k += kQuad, w += kQuad * kInt8PanelColumns) {
    __m512i factors[kQuadVectors];
#pragma GCC unroll 4
    for (int v = 0; v < kQuadVectors; ++v) factors[v] = _mm512_loadu_si512(w + v * kQuadLanes * kQuad);
#pragma GCC unroll 8
    for (int r = 0; r < kRows; ++r) {
      std::int32_t quad = 0;
      std::memcpy(&quad, x + r * kInt8Group + k, sizeof quad);
      const __m512i factor = _mm512_set1_epi32(quad);
      // By the instruction itself: GCC 12 copies the sums of its intrinsic from register to register in every round.
#pragma GCC unroll 4
      for (int v = 0; v < kQuadVectors; ++v)
        asm("vpdpbusd %2, %1, %0" : "+v"(sums[r][v]) : "v"(factor), "v"(factors[v]));
    }
  }
#pragma GCC unroll 4
  for (int v = 0; v < kQuadVectors; ++v) {
    const __m512 column_scales = _mm512_loadu_ps(w_scales + v * kQuadLanes);
#pragma GCC unroll 8
    for (int r = 0; r < kRows; ++r) {
      float* to = out + r * kInt8PanelColumns + v * kQuadLanes;
      const __m512 scale = _mm512_mul_ps(column_scales, _mm512_set1_ps(x_scales[r]));
      const __m512 value = _mm512_mul_ps(_mm512_cvtepi32_ps(sums[r][v]), scale);
      _mm512_storeu_ps(to, adds ? _mm512_add_ps(_mm512_loadu_ps(to), value) : value);
    }
  }
}

template <int kRows>
ANIGEN_VNNI void quad_rows(const std::uint8_t* x, const float* x_scales, const std::int8_t* w, const float* w_scales,
                           const std::int32_t* starts, bool adds, float* out) {
  quad_tile<kRows>(x, x_scales, w, w_scales, starts, adds, out);
}

// wide_group() by AVX512-VNNI.
void quad_group(const std::uint8_t* x, const float* x_scales, std::int64_t rows, const std::int8_t* w,
                const float* w_scales, const std::int32_t* starts, bool adds, float* out) {
  static constexpr auto kTiles =
      std::array{quad_rows<1>, quad_rows<2>, quad_rows<3>, quad_rows<4>, quad_rows<5>, quad_rows<kQuadRows>};
  for (std::int64_t r = 0; r < rows; r += kQuadRows) {
    const auto count = static_cast<std::size_t>(std::min<std::int64_t>(kQuadRows, rows - r));
    kTiles[count - 1](x + r * kInt8Group, x_scales + r, w, w_scales, starts, adds, out + r * kInt8PanelColumns);
  }
}

#pragma GCC diagnostic pop

#endif

}  // namespace

bool has_int8_products() {
#if ANIGEN_INT8_X86
  static const bool has = __builtin_cpu_supports("avx512vnni") != 0 && __builtin_cpu_supports("avx512bw") != 0 &&
                          __builtin_cpu_supports("avx512vl") != 0;
  return has && kernel_form() >= KernelForm::kAvx512;
#else
  return false;
#endif
}

Int8Matrix round_to_int8(const float* weight, std::int64_t columns, std::int64_t depth) {
  Int8Matrix matrix;
  matrix.depth = depth;
  matrix.columns = columns;
  const std::int64_t groups = matrix.groups(), padded = matrix.padded_columns();
  matrix.values.assign(static_cast<std::size_t>(padded * groups * kInt8Group), 0);
  matrix.scales.assign(static_cast<std::size_t>(groups * padded), 0.0F);
  matrix.starts.assign(static_cast<std::size_t>(groups * padded), 0);
  for (std::int64_t c = 0; c < columns; ++c) {
    const float* row = weight + c * depth;
    const float whole = int8_scale(largest_of(row, depth));
    const bool stored = whole > 0.0F && are_multiples(row, depth, whole);
    for (std::int64_t g = 0; g < groups; ++g) {
      const std::int64_t first = g * kInt8Group, count = std::min(kInt8Group, depth - first);
      const float scale = stored ? whole : int8_scale(largest_of(row + first, count));
      int sum = 0;
      for (std::int64_t k = first; k < first + count && scale > 0.0F; ++k) {
        const int q = static_cast<int>(std::lrint(row[k] / scale));
        matrix.values[place(matrix, c, k)] = static_cast<std::int8_t>(q);
        sum += q;
      }
      matrix.scales[static_cast<std::size_t>(g * padded + c)] = scale;
      matrix.starts[static_cast<std::size_t>(g * padded + c)] = -kInt8Middle * sum;
    }
  }
  return matrix;
}

void widen_int8(const Int8Matrix& matrix, float* weight) {
  for (std::int64_t c = 0; c < matrix.columns; ++c) {
    for (std::int64_t k = 0; k < matrix.depth; ++k) {
      const auto scale = static_cast<std::size_t>(k / kInt8Group * matrix.padded_columns() + c);
      weight[c * matrix.depth + k] = matrix.scales[scale] * static_cast<float>(matrix.values[place(matrix, c, k)]);
    }
  }
}

void round_rows_to_int8(const float* x, std::int64_t rows, std::int64_t depth, std::int64_t stride, Int8Rows& rounded) {
  round_all_groups(x, rows, depth, stride, rounded, round_groups);
}

void round_rows_to_int8(const std::uint16_t* x, std::int64_t rows, std::int64_t depth, std::int64_t stride,
                        Int8Rows& rounded) {
  round_all_groups(x, rows, depth, stride, rounded, round_bf16_groups);
}

ANIGEN_KERNEL(void, add_bias_to_panel,
              (const float* panel, std::int64_t rows, std::int64_t columns, const float* bias, float* out,
               std::int64_t stride),
              (panel, rows, columns, bias, out, stride)) {
  add_bias(panel, rows, columns, bias, out, stride);
}

ANIGEN_KERNEL(void, add_bias_to_panel,
              (const float* panel, std::int64_t rows, std::int64_t columns, const float* bias, std::uint16_t* out,
               std::int64_t stride),
              (panel, rows, columns, bias, out, stride)) {
  add_bias(panel, rows, columns, bias, out, stride);
}

void multiply_int8(const Int8Rows& x, std::int64_t rows, const Int8Matrix& matrix, std::int64_t panel, float* out) {
  const std::int64_t groups = matrix.groups(), padded = matrix.padded_columns(), column = panel * kInt8PanelColumns;
  const std::int8_t* w = matrix.values.data() + column * groups * kInt8Group;
  const bool quads = has_int8_products();
  for (std::int64_t g = 0; g < groups; ++g, w += kInt8Group * kInt8PanelColumns) {
    const std::uint8_t* values = x.values.data() + g * rows * kInt8Group;
    const float *scales = x.scales.data() + g * rows, *w_scales = matrix.scales.data() + g * padded + column;
#if ANIGEN_INT8_X86
    if (quads) {
      quad_group(values, scales, rows, w, w_scales, matrix.starts.data() + g * padded + column, g > 0, out);
      continue;
    }
#endif
    wide_group(values, scales, rows, w, w_scales, g > 0, out);
  }
}

}  // namespace anigen::nn::kernels
