#pragma once
#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <string>

#include "anigen/io/image.h"

namespace anigen::render {

/// sRGB in [0, 1] as bytes.
inline std::array<std::uint8_t, 3> color_bytes(const Eigen::Vector3f& color) {
  std::array<std::uint8_t, 3> bytes{};
  for (std::size_t c = 0; c < 3; ++c) {
    const float value = std::clamp(color[static_cast<Eigen::Index>(c)], 0.0f, 1.0f);
    bytes[c] = static_cast<std::uint8_t>(std::lround(255.0f * value));
  }
  return bytes;
}

/// A line in the characters that captions can show: one '?' for each other character of its UTF-8.
inline std::string printable_ascii(const std::string& line) {
  std::string result;
  for (const char c : line) {
    const auto value = static_cast<unsigned char>(c);
    if (value >= 0x80 && value < 0xC0) continue;  // continues a character
    result += value >= 0x20 && value < 0x7F ? c : '?';
  }
  return result;
}

/// Draws one line on a sheet, antialiased, centred in the columns [x, x + width): printable_ascii() of it, reduced as a
/// whole where it is too wide. Alpha is left as it is; ink beyond the sheet is lost.
/// @param y row of the baseline @param height of a capital letter, pixels @param color sRGB
void put_caption(io::Image& sheet, const std::string& line, int x, int width, int y, int height,
                 const Eigen::Vector3f& color);

}  // namespace anigen::render
