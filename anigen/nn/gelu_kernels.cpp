#include "anigen/nn/gelu_kernels.h"

#include <cstring>

// The loops are compiled once per instruction set, and the program picks when it starts. GCC vectorises the clamps only
// when told that floating-point comparisons do not trap, which nothing here enables.
#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__)
#define ANIGEN_VECTOR_CLONES __attribute__((target_clones("avx512f", "avx2", "default")))
#define ANIGEN_INLINE inline __attribute__((always_inline))
#pragma GCC push_options
#pragma GCC optimize("no-trapping-math")
#else
#define ANIGEN_VECTOR_CLONES
#define ANIGEN_INLINE inline
#endif

namespace anigen::nn::kernels {
namespace {

constexpr float kSqrtTwoOverPi = 0.7978845608028654F;
constexpr float kCubic = 0.044715F;

// e^t to about one unit in the last place for |t| <= 87, clamped beyond; NaN stays NaN. Branch-free, so that loops over
// it are vectorised: t = n ln 2 + r with |r| <= ln 2 / 2, and a polynomial for e^r (coefficients of Cephes' expf).
ANIGEN_INLINE float exp_clamped(float t) {
  t = t > 87.0F ? 87.0F : t;
  t = t < -87.0F ? -87.0F : t;
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
  std::uint32_t bits;
  std::memcpy(&bits, &shifted, sizeof bits);
  bits = (bits << 23) + 0x3F800000U;  // the number 2^n
  float scale;
  std::memcpy(&scale, &bits, sizeof scale);
  return p * scale;
}

// (1 + tanh(u)) / 2 as sigmoid(2u), which does not cancel for negative values.
ANIGEN_INLINE float gate(float x) {
  const float u = kSqrtTwoOverPi * (x + kCubic * (x * x * x));
  return 1.0F / (1.0F + exp_clamped(-2.0F * u));
}

}  // namespace

ANIGEN_VECTOR_CLONES
void gelu_forward(const float* __restrict x, float* __restrict y, std::int64_t n) {
  for (std::int64_t i = 0; i < n; ++i) y[i] = x[i] * gate(x[i]);
}

ANIGEN_VECTOR_CLONES
void gelu_backward(const float* __restrict x, const float* __restrict dy, float* __restrict dx, std::int64_t n) {
  for (std::int64_t i = 0; i < n; ++i) {
    const float s = gate(x[i]);
    const float slope = kSqrtTwoOverPi * (1.0F + 3.0F * kCubic * (x[i] * x[i]));
    dx[i] = dy[i] * (s + 2.0F * x[i] * s * (1.0F - s) * slope);
  }
}

}  // namespace anigen::nn::kernels

#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__)
#pragma GCC pop_options
#endif
