#pragma once
#include <cstdint>

namespace anigen::nn::kernels {

/// y[i] = gelu(x[i]), tanh form; NaN stays NaN. Arrays of n values that do not overlap.
void gelu_forward(const float* x, float* y, std::int64_t n);

/// dx[i] = dy[i] · gelu'(x[i])
void gelu_backward(const float* x, const float* dy, float* dx, std::int64_t n);

}  // namespace anigen::nn::kernels
