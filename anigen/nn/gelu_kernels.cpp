#include "anigen/nn/gelu_kernels.h"

#include "anigen/nn/vector_exp.h"

namespace anigen::nn::kernels {
namespace {

constexpr float kSqrtTwoOverPi = 0.7978845608028654F;
constexpr float kCubic = 0.044715F;

// (1 + tanh(u)) / 2 as sigmoid(2u), which does not cancel for negative values.
ANIGEN_INLINE float gate(float x) {
  const float u = kSqrtTwoOverPi * (x + kCubic * (x * x * x));
  return 1.0F / (1.0F + exp_clamped(-2.0F * u));
}

// d/dx of x gate(x), given gate(x).
ANIGEN_INLINE float derivative(float x, float s) {
  const float slope = kSqrtTwoOverPi * (1.0F + 3.0F * kCubic * (x * x));
  return s + 2.0F * x * s * (1.0F - s) * slope;
}

}  // namespace

ANIGEN_KERNEL(void, gelu_forward, (const float* __restrict x, float* __restrict y, std::int64_t n), (x, y, n)) {
  for (std::int64_t i = 0; i < n; ++i) y[i] = x[i] * gate(x[i]);
}

ANIGEN_KERNEL(void, gelu_backward,
              (const float* __restrict x, const float* __restrict dy, float* __restrict dx, std::int64_t n),
              (x, dy, dx, n)) {
  for (std::int64_t i = 0; i < n; ++i) dx[i] = dy[i] * derivative(x[i], gate(x[i]));
}

ANIGEN_KERNEL(void, gelu_bias,
              (float* __restrict h, const float* __restrict bias, std::int64_t rows, std::int64_t columns),
              (h, bias, rows, columns)) {
  for (std::int64_t r = 0; r < rows; ++r, h += columns) {
    for (std::int64_t c = 0; c < columns; ++c) {
      const float x = h[c] + bias[c];
      h[c] = x * gate(x);
    }
  }
}

ANIGEN_KERNEL(void, gelu_bias_backward,
              (float* __restrict h, const float* __restrict bias, float* __restrict dh, std::int64_t rows,
               std::int64_t columns),
              (h, bias, dh, rows, columns)) {
  for (std::int64_t r = 0; r < rows; ++r, h += columns, dh += columns) {
    for (std::int64_t c = 0; c < columns; ++c) {
      const float x = h[c] + bias[c], s = gate(x);
      h[c] = x * s;
      dh[c] *= derivative(x, s);
    }
  }
}

}  // namespace anigen::nn::kernels
