#pragma once
#include <cstdint>

/// Norms and modulation of dense rows of fp32 numbers or of bf16 numbers as their 16 bits, computed in fp32; one
/// thread, no allocation.
namespace anigen::nn::kernels {

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

/// What norm_rows gives for rows with that mean and 1 / σ, [rows].
void scale_rows(const RowNorm& norm, const float* x, const float* factor, const float* shift, const float* mean,
                const float* rstd, float* y);

/// Adds to d_factor and d_shift, [C].
void norm_rows_backward(const RowNorm& norm, const float* x, const float* dy, const float* factor, const float* mean,
                        const float* rstd, float* dx, float* d_factor, float* d_shift, const RowScratch& scratch);
void norm_rows_backward(const RowNorm& norm, const std::uint16_t* x, const std::uint16_t* dy, const float* factor,
                        const float* mean, const float* rstd, std::uint16_t* dx, float* d_factor, float* d_shift,
                        const RowScratch& scratch);

/// y = x + gate · result @param gate [C] of all rows
void add_gated_rows(std::int64_t rows, std::int64_t channels, const float* x, const float* gate, const float* result,
                    float* y);
void add_gated_rows(std::int64_t rows, std::int64_t channels, const std::uint16_t* x, const float* gate,
                    const std::uint16_t* result, std::uint16_t* y);

/// d_result = gate · dy; adds Σ dy · result to d_gate, [C].
void add_gated_rows_backward(std::int64_t rows, std::int64_t channels, const float* dy, const float* gate,
                             const float* result, float* d_result, float* d_gate);
void add_gated_rows_backward(std::int64_t rows, std::int64_t channels, const std::uint16_t* dy, const float* gate,
                             const std::uint16_t* result, std::uint16_t* d_result, float* d_gate);

}  // namespace anigen::nn::kernels
