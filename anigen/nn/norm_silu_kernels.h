#pragma once
#include <cstdint>

#include "anigen/nn/row_kernels.h"

/// SiLU(u) = u / (1 + e^−u) of normalised dense rows of fp32 numbers; one thread.
namespace anigen::nn::kernels {

/// y = SiLU(LN(x) (base + factor) + shift), otherwise as norm_rows().
void norm_silu_rows(const RowNorm& norm, const float* x, const float* factor, const float* shift, float* y, float* mean,
                    float* rstd);

/// Adds to d_factor and d_shift, [C]. What SiLU was applied to is computed again, some rows at a time.
void norm_silu_rows_backward(const RowNorm& norm, const float* x, const float* dy, const float* factor,
                             const float* shift, const float* mean, const float* rstd, float* dx, float* d_factor,
                             float* d_shift);

}  // namespace anigen::nn::kernels
