#pragma once
#include <cstddef>
#include <cstdint>
#include <string>
#include <type_traits>
#include <vector>

/// Two things that nearly every file with geometry in it needs.

namespace anigen {

inline constexpr double kPi = 3.14159265358979323846;

/// A whole number known not to be negative (joint, vertex and face numbers are int) as a subscript of a standard
/// container.
template <typename Integer>
constexpr std::size_t at(Integer index) {
  static_assert(std::is_integral_v<Integer>, "a subscript is a whole number");
  return static_cast<std::size_t>(index);
}

/// Percentile p (0–100) of the values, linearly interpolated between neighbours as numpy does by default.
/// @pre values is not empty
double percentile(std::vector<float> values, double p);

/// An id for a caption: of a long one, such as the SHA-256 of a file, the first eight characters.
inline std::string short_id(const std::string& id) {
  constexpr std::size_t kLongest = 24, kKept = 8;
  return id.size() <= kLongest ? id : id.substr(0, kKept);
}

/// a · b / 255, rounded, in integers as Pillow blends: bytes that stand for numbers in [0, 1].
inline std::uint8_t byte_product(int a, int b) {
  const int product = a * b + 128;
  return static_cast<std::uint8_t>(((product >> 8) + product) >> 8);
}

}  // namespace anigen
