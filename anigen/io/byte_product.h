#pragma once
#include <cstdint>

namespace anigen::io {

/// a · b / 255, rounded, in integers as Pillow blends: bytes that stand for numbers in [0, 1].
inline std::uint8_t byte_product(int a, int b) {
  const int product = a * b + 128;
  return static_cast<std::uint8_t>(((product >> 8) + product) >> 8);
}

}  // namespace anigen::io
