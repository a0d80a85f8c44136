#pragma once
#include <cstdint>

namespace anigen::raster {

inline constexpr std::int64_t kMostPixelsPerSide = 16384;
inline constexpr std::int64_t kMostSubpixelBits = 12;  // positions and products of them then fit in 32 and 64 bits

/// A picture's pixels and the grid to which corners are snapped before coverage is decided.
struct Viewport {
  std::int64_t height = 0, width = 0;
  std::int64_t subpixel_bits = 4;  ///< steps of 1/2^bits pixel

  /// x/w of a column's centre, y/w of a row's.
  double x(std::int64_t column) const { return static_cast<double>(2 * column + 1) / static_cast<double>(width) - 1.0; }
  double y(std::int64_t row) const { return static_cast<double>(2 * row + 1) / static_cast<double>(height) - 1.0; }
  double half_width() const { return 0.5 * static_cast<double>(width); }
  double half_height() const { return 0.5 * static_cast<double>(height); }
};

}  // namespace anigen::raster
