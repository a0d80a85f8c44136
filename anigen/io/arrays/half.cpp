#include "anigen/io/arrays/half.h"

#include <cmath>
#include <cstring>

namespace anigen::io {
namespace {

std::uint32_t bits_of(float value) {
  std::uint32_t bits;
  std::memcpy(&bits, &value, sizeof bits);
  return bits;
}

float float_of(std::uint32_t bits) {
  float value;
  std::memcpy(&value, &bits, sizeof value);
  return value;
}

/// Drops the low bits of a magnitude, rounding to nearest even. A carry runs on into the exponent, as it should.
std::uint32_t shift_rounding_to_even(std::uint32_t magnitude, int bits) {
  const std::uint32_t half_way = 1u << (bits - 1);
  const std::uint32_t odd = (magnitude >> bits) & 1u;
  return (magnitude + half_way - 1u + odd) >> bits;
}

}  // namespace

float half_to_float(std::uint16_t half) {
  const std::uint32_t sign = static_cast<std::uint32_t>(half & 0x8000u) << 16;
  const std::uint32_t exponent = (half >> 10) & 0x1Fu;
  const std::uint32_t fraction = half & 0x3FFu;
  if (exponent == 0x1F) return float_of(sign | 0x7F800000u | (fraction << 13));
  if (exponent != 0) return float_of(sign | ((exponent + 112u) << 23) | (fraction << 13));
  const float magnitude = std::ldexp(static_cast<float>(fraction), -24);  // zero and subnormals
  return sign ? -magnitude : magnitude;
}

float bfloat16_to_float(std::uint16_t bfloat16) { return float_of(static_cast<std::uint32_t>(bfloat16) << 16); }

std::uint16_t float_to_half(float value) {
  const std::uint32_t bits = bits_of(value);
  const std::uint32_t sign = (bits >> 16) & 0x8000u;
  const std::uint32_t magnitude = bits & 0x7FFFFFFFu;
  std::uint32_t result;
  if (magnitude > 0x7F800000u) {
    result = 0x7E00u | ((magnitude >> 13) & 0x3FFu);  // quiet NaN
  } else if (magnitude >= 0x477FF000u) {              // 65520 and above round to infinity
    result = 0x7C00u;
  } else if (magnitude >= 0x38800000u) {  // normal halves start at 2^-14
    result = shift_rounding_to_even(magnitude - (112u << 23), 13);
  } else {
    const int exponent = static_cast<int>(magnitude >> 23);
    const int shift = 126 - exponent;  // a subnormal half counts units of 2^-24
    result = shift > 24 ? 0u : shift_rounding_to_even((magnitude & 0x7FFFFFu) | 0x800000u, shift);
  }
  return static_cast<std::uint16_t>(sign | result);
}

std::uint16_t float_to_bfloat16(float value) {
  const std::uint32_t bits = bits_of(value);
  if ((bits & 0x7FFFFFFFu) > 0x7F800000u) return static_cast<std::uint16_t>((bits >> 16) | 0x40u);
  return static_cast<std::uint16_t>(((bits >> 16) & 0x8000u) | shift_rounding_to_even(bits & 0x7FFFFFFFu, 16));
}

}  // namespace anigen::io
