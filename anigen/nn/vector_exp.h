#pragma once
#include <cstdint>
#include <cstring>

#include "anigen/core/kernel_form.h"

/// For sources with loops over arrays of floats: functions are defined by ANIGEN_KERNEL, and what they call in their
/// loops is marked so.
#define ANIGEN_INLINE ANIGEN_KERNEL_INLINE

namespace anigen::nn::kernels {

template <typename To, typename From>
ANIGEN_INLINE To bits_as(From from) {
  static_assert(sizeof(To) == sizeof(From), "same size");
  To to;
  std::memcpy(&to, &from, sizeof to);
  return to;
}

/// e^t to about one unit in the last place for |t| <= 87. Nothing but arithmetic, so that loops over it are vectorised:
/// t = n ln 2 + r with |r| <= ln 2 / 2, and a polynomial for e^r (coefficients of Cephes' expf).
ANIGEN_INLINE float exp_within_87(float t) {
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

/// e^t, clamped beyond |t| = 87 (and for NaN). The clamp works on the bits, since compilers do not vectorise
/// comparisons of floats, which might trap.
ANIGEN_INLINE float exp_clamped(float t) {
  const auto bits = bits_as<std::int32_t>(t);
  constexpr std::int32_t kBitsOf87 = 0x42AE0000, kMagnitude = 0x7FFFFFFF;
  const std::int32_t magnitude = bits & kMagnitude;
  const std::int32_t clamped = magnitude < kBitsOf87 ? magnitude : kBitsOf87;
  return exp_within_87(bits_as<float>(clamped | (bits & ~kMagnitude)));
}

/// The same for t <= 0 with fewer operations. Anything for NaN.
ANIGEN_INLINE float exp_up_to_0(float t) {
  const auto bits = bits_as<std::uint32_t>(t);
  constexpr std::uint32_t kBitsOfMinus87 = 0xC2AE0000U;
  return exp_within_87(bits_as<float>(bits < kBitsOfMinus87 ? bits : kBitsOfMinus87));
}

/// exp_clamped, but NaN for NaN and infinities.
ANIGEN_INLINE float exp_or_nan(float t) { return exp_clamped(t) + 0.0F * t; }

}  // namespace anigen::nn::kernels
