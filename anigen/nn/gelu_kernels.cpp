#include "anigen/nn/gelu_kernels.h"

#include <cstring>

// The loops are compiled once per instruction set, and the program picks when it starts.
#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__)
#define ANIGEN_VECTOR_CLONES __attribute__((target_clones("avx512f", "avx2", "default")))
#define ANIGEN_INLINE inline __attribute__((always_inline))
#else
#define ANIGEN_VECTOR_CLONES
#define ANIGEN_INLINE inline
#endif

namespace anigen::nn::kernels {
namespace {

constexpr float kSqrtTwoOverPi = 0.7978845608028654F;
constexpr float kCubic = 0.044715F;

template <typename To, typename From>
ANIGEN_INLINE To bits_as(From from) {
  static_assert(sizeof(To) == sizeof(From), "same size");
  To to;
  std::memcpy(&to, &from, sizeof to);
  return to;
}

// e^t to about one unit in the last place for |t| <= 87, clamped beyond (and for NaN). Nothing but arithmetic, so that
// loops over it are vectorised: t = n ln 2 + r with |r| <= ln 2 / 2, and a polynomial for e^r (coefficients of Cephes'
// expf). The clamp works on the bits, since compilers do not vectorise comparisons of floats, which might trap.
ANIGEN_INLINE float exp_clamped(float t) {
  const auto bits = bits_as<std::int32_t>(t);
  constexpr std::int32_t kBitsOf87 = 0x42AE0000, kMagnitude = 0x7FFFFFFF;
  const std::int32_t magnitude = bits & kMagnitude;
  const std::int32_t clamped = magnitude < kBitsOf87 ? magnitude : kBitsOf87;
  t = bits_as<float>(clamped | (bits & ~kMagnitude));
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

ANIGEN_VECTOR_CLONES
void gelu_forward(const float* __restrict x, float* __restrict y, std::int64_t n) {
  for (std::int64_t i = 0; i < n; ++i) y[i] = x[i] * gate(x[i]);
}

ANIGEN_VECTOR_CLONES
void gelu_backward(const float* __restrict x, const float* __restrict dy, float* __restrict dx, std::int64_t n) {
  for (std::int64_t i = 0; i < n; ++i) dx[i] = dy[i] * derivative(x[i], gate(x[i]));
}

ANIGEN_VECTOR_CLONES
void gelu_bias(float* __restrict h, const float* __restrict bias, std::int64_t rows, std::int64_t columns) {
  for (std::int64_t r = 0; r < rows; ++r, h += columns) {
    for (std::int64_t c = 0; c < columns; ++c) {
      const float x = h[c] + bias[c];
      h[c] = x * gate(x);
    }
  }
}

ANIGEN_VECTOR_CLONES
void gelu_bias_backward(float* __restrict h, const float* __restrict bias, float* __restrict dh, std::int64_t rows,
                        std::int64_t columns) {
  for (std::int64_t r = 0; r < rows; ++r, h += columns, dh += columns) {
    for (std::int64_t c = 0; c < columns; ++c) {
      const float x = h[c] + bias[c], s = gate(x);
      h[c] = x * s;
      dh[c] *= derivative(x, s);
    }
  }
}

}  // namespace anigen::nn::kernels
