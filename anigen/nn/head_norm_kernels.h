#pragma once
#include <cstdint>

/// Norms of the heads of rows of fp32 numbers or of bf16 numbers as their 16 bits, computed in fp32; one thread, no
/// allocation.
namespace anigen::nn::kernels {

/// Rows of heads of adjacent channels, the rows of x at a distance and those of the others dense.
struct HeadNorm {
  std::int64_t rows, heads, channels, x_stride;
};

/// y = x / max(‖x‖₂, 1e-12) · factors, per row and head @param factors [H, D]
void rms_norm_rows(const HeadNorm& norm, const float* x, const float* factors, float* y);
void rms_norm_rows(const HeadNorm& norm, const std::uint16_t* x, const float* factors, std::uint16_t* y,
                   float* scratch);

/// Adds to d_factors, [H, D]. @param dx dense
void rms_norm_rows_backward(const HeadNorm& norm, const float* x, const float* dy, const float* factors, float* dx,
                            float* d_factors);

}  // namespace anigen::nn::kernels
