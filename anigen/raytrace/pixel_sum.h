#pragma once
#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <cstdint>

#include "anigen/raytrace/srgb.h"

namespace anigen::raytrace {

/// The samples of one pixel: colour times alpha, linear, and alpha.
struct PixelSum {
  Eigen::Vector3f color = Eigen::Vector3f::Zero();
  float alpha = 0.0f;

  /// @param premultiplied colour times alpha
  void add(const Eigen::Vector3f& premultiplied, float opacity) {
    color += premultiplied;
    alpha += opacity;
  }

  PixelSum scaled(float factor) const { return {factor * color, std::min(1.0f, factor * alpha)}; }

  /// Over an opaque background.
  PixelSum over(const Eigen::Vector3f& background) const { return {color + (1.0f - alpha) * background, 1.0f}; }

  /// As RGBA with straight alpha, [4]. @param srgb encode the colour; false: store the numbers as they are
  void store_straight(std::uint8_t* pixel, bool srgb) const {
    for (Eigen::Index c = 0; c < 3; ++c) {
      const float value = alpha > 0.0f ? color[c] / alpha : 0.0f;
      const float shown = srgb ? linear_to_srgb(value) : std::clamp(value, 0.0f, 1.0f);
      pixel[c] = static_cast<std::uint8_t>(std::lround(255.0f * shown));
    }
    pixel[3] = static_cast<std::uint8_t>(std::lround(255.0f * alpha));
  }
};

}  // namespace anigen::raytrace
