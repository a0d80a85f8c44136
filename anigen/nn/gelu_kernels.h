#pragma once
#include <cstdint>

namespace anigen::nn::kernels {

/// y[i] = gelu(x[i]), tanh form; NaN stays NaN. Arrays of n values that do not overlap.
void gelu_forward(const float* x, float* y, std::int64_t n);

/// h[r, c] = gelu(h[r, c] + bias[c]) in place, for a dense matrix.
void gelu_bias(float* h, const float* bias, std::int64_t rows, std::int64_t columns);

/// The backward pass of gelu_bias, recomputing its result: on return h[r, c] holds gelu(h[r, c] + bias[c]) and
/// dh[r, c] is multiplied with the derivative there.
void gelu_bias_backward(float* h, const float* bias, float* dh, std::int64_t rows, std::int64_t columns);

/// dx[i] = dy[i] · gelu'(x[i])
void gelu_backward(const float* x, const float* dy, float* dx, std::int64_t n);

}  // namespace anigen::nn::kernels
