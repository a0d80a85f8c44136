#pragma once
#include <algorithm>
#include <cmath>

namespace anigen::raytrace {

/// IEC 61966-2-1, both directions, for values in [0, 1].
inline float srgb_to_linear(float value) {
  return value <= 0.04045f ? value / 12.92f : std::pow((value + 0.055f) / 1.055f, 2.4f);
}

inline float linear_to_srgb(float value) {
  value = std::clamp(value, 0.0f, 1.0f);
  return value <= 0.0031308f ? 12.92f * value : 1.055f * std::pow(value, 1.0f / 2.4f) - 0.055f;
}

}  // namespace anigen::raytrace
