#pragma once
#include <cstdint>

#include "anigen/nn/kernels/tiles.h"
#include "anigen/nn/ragged_attention.h"

/// For kernels over rows of fp32 numbers, or of bf16 numbers as their 16 bits, whose loops hold vectors: everything is
/// inlined into functions defined by ANIGEN_KERNEL.

/// Norms and modulation of dense rows of fp32 numbers or of bf16 numbers as their 16 bits, computed in fp32; one
/// thread, no allocation.

namespace anigen::nn::kernels {

/// Partial sums side by side, since compilers keep the order of additions of floats. Eight for rows that sixteen would
/// leave half to single numbers.
typedef float Sixteen __attribute__((vector_size(64)));
typedef float Eight __attribute__((vector_size(32)));
typedef float UnalignedSixteen __attribute__((vector_size(64), aligned(4), may_alias));
typedef float UnalignedEight __attribute__((vector_size(32), aligned(4), may_alias));

struct Wide {
  using Lanes = Sixteen;
  using Unaligned = UnalignedSixteen;
  static constexpr std::int64_t kLanes = 16;
};

struct Narrow {
  using Lanes = Eight;
  using Unaligned = UnalignedEight;
  static constexpr std::int64_t kLanes = 8;
};

/// True when rows are better taken by sixteen.
inline bool fills_wide(std::int64_t channels) { return channels % Wide::kLanes < Narrow::kLanes; }

/// By reference, and inlined: how vectors are passed depends on the instruction set.
ANIGEN_INLINE float total(const Eight& lanes) {
  return ((lanes[0] + lanes[4]) + (lanes[2] + lanes[6])) + ((lanes[1] + lanes[5]) + (lanes[3] + lanes[7]));
}

ANIGEN_INLINE float total(const Sixteen& lanes) {
  Eight halves;
  for (int i = 0; i < 8; ++i) halves[i] = lanes[i] + lanes[i + 8];
  return total(halves);
}

template <typename Width>
ANIGEN_INLINE const typename Width::Unaligned& lanes_at(const float* values) {
  return *reinterpret_cast<const typename Width::Unaligned*>(values);
}

template <typename Width>
ANIGEN_INLINE typename Width::Unaligned& lanes_at(float* values) {
  return *reinterpret_cast<typename Width::Unaligned*>(values);
}

/// A row in fp32: itself, or widened into scratch.
ANIGEN_INLINE const float* widened(const float* values, std::int64_t, float*) { return values; }

ANIGEN_INLINE const float* widened(const std::uint16_t* values, std::int64_t n, float* wide) {
  for (std::int64_t c = 0; c < n; ++c) wide[c] = bits_as<float>(static_cast<std::uint32_t>(values[c]) << 16);
  return wide;
}

/// Precision of results: in place, or in fp32 before they are rounded.
ANIGEN_INLINE float* wide_row(float* values, float*) { return values; }
ANIGEN_INLINE float* wide_row(std::uint16_t*, float* wide) { return wide; }

ANIGEN_INLINE void round_row(const float*, std::int64_t, float*) {}

/// To the nearest, ties to even; NaN stays NaN.
ANIGEN_INLINE void round_row(const float* wide, std::int64_t n, std::uint16_t* values) {
  for (std::int64_t c = 0; c < n; ++c) {
    const auto bits = bits_as<std::uint32_t>(wide[c]);
    const std::uint32_t rounded = (bits + 0x7FFFU + ((bits >> 16) & 1U)) >> 16;
    const bool is_nan = (bits & 0x7FFFFFFFU) > 0x7F800000U;
    values[c] = static_cast<std::uint16_t>(is_nan ? 0x7FC0U : rounded);
  }
}

/// Of a layer norm with y = x̂ (base + factor) + shift, x̂ = (x − μ) / √(σ² + eps), σ² biased.
struct RowNorm {
  std::int64_t rows, channels;
  float base, eps;
};

/// Space for `channels` fp32 numbers each; not read or written for fp32 rows.
struct RowScratch {
  float *x, *dy;
};

/// @param factor, shift [C] of all rows @param mean, rstd [rows], for the backward pass
void norm_rows(const RowNorm& norm, const float* x, const float* factor, const float* shift, float* y, float* mean,
               float* rstd, const RowScratch& scratch);
void norm_rows(const RowNorm& norm, const std::uint16_t* x, const float* factor, const float* shift, std::uint16_t* y,
               float* mean, float* rstd, const RowScratch& scratch);

/// Result of norm_rows for rows with that mean and 1 / σ, [rows].
void scale_rows(const RowNorm& norm, const float* x, const float* factor, const float* shift, const float* mean,
                const float* rstd, float* y);

/// Adds to d_factor and d_shift, [C].
void norm_rows_backward(const RowNorm& norm, const float* x, const float* dy, const float* factor, const float* mean,
                        const float* rstd, float* dx, float* d_factor, float* d_shift, const RowScratch& scratch);
void norm_rows_backward(const RowNorm& norm, const std::uint16_t* x, const std::uint16_t* dy, const float* factor,
                        const float* mean, const float* rstd, std::uint16_t* dx, float* d_factor, float* d_shift,
                        const RowScratch& scratch);

}  // namespace anigen::nn::kernels

namespace anigen::nn {

/// Adaptive layer norm of a ragged batch, one row of shift and scale per item (docs/reference/flows.md, 1.4): LN(x) (1
/// + scale) + shift, without parameters of its own: biased variance, eps inside the root. On a CPU, fp32 and bf16 take
/// one pass over memory forward and two backward, bf16 computed in fp32 throughout; they can be differentiated once.
/// @param x [N, C] @param shift, scale [B, C], B the items @return the shape and dtype of x
Tensor modulated_norm(const Tensor& x, const Ragged& items, const Tensor& shift, const Tensor& scale, double eps);

/// LN(x) weight + bias of all rows, otherwise the same. 16-bit input is normalised in fp32 and cast back.
/// @param x [..., C] @param weight, bias [C]
Tensor affine_norm(const Tensor& x, const Tensor& weight, const Tensor& bias, double eps);

/// x + gate · result, one row of gates per item. @param x, result [N, C] @param gate [B, C]
Tensor add_gated(const Tensor& x, const Ragged& items, const Tensor& gate, const Tensor& result);

}  // namespace anigen::nn
