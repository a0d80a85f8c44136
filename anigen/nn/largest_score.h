#pragma once
#include <cstdint>

#include "anigen/nn/vector_exp.h"

namespace anigen::nn::kernels {

/// Integers in the order of the floats with these bits; its own inverse. Compilers vectorise the maximum of integers,
/// but not that of floats, which has rules for NaN.
ANIGEN_INLINE std::int32_t ordered_bits(std::int32_t bits) { return bits ^ ((bits >> 31) & 0x7FFFFFFF); }

/// The largest of a row of scores and `start`.
ANIGEN_INLINE float largest_score(const float* row, std::int64_t n, float start) {
  std::int32_t largest = ordered_bits(bits_as<std::int32_t>(start));
  for (std::int64_t c = 0; c < n; ++c) {
    const std::int32_t key = ordered_bits(bits_as<std::int32_t>(row[c]));
    largest = largest > key ? largest : key;
  }
  return bits_as<float>(ordered_bits(largest));
}

struct ScoreRange {
  float smallest, largest;
};

/// The smallest and the largest of a row of scores, the largest of `start` as well. NaN and infinities come out of it:
/// negative NaN is the smallest of all, positive NaN the largest.
ANIGEN_INLINE ScoreRange score_range(const float* row, std::int64_t n, float start) {
  std::int32_t smallest = 0x7FFFFFFF, largest = ordered_bits(bits_as<std::int32_t>(start));
  for (std::int64_t c = 0; c < n; ++c) {
    const std::int32_t key = ordered_bits(bits_as<std::int32_t>(row[c]));
    smallest = smallest < key ? smallest : key;
    largest = largest > key ? largest : key;
  }
  return {bits_as<float>(ordered_bits(smallest)), bits_as<float>(ordered_bits(largest))};
}

}  // namespace anigen::nn::kernels
