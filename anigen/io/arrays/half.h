#pragma once
#include <cstdint>

namespace anigen::io {

/// 16-bit floats as they lie in files. To float is exact (NaN payloads and subnormals included); from float rounds to
/// nearest, ties to even, and overflows to infinity, as IEEE 754 and every deep-learning framework do.
float half_to_float(std::uint16_t half);          ///< IEEE binary16: 1 sign, 5 exponent, 10 fraction bits
float bfloat16_to_float(std::uint16_t bfloat16);  ///< the upper half of a float
std::uint16_t float_to_half(float value);
std::uint16_t float_to_bfloat16(float value);

}  // namespace anigen::io
