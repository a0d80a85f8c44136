#pragma once
/// Two things that nearly every file with geometry in it needs.

#include <cstddef>

namespace anigen {

inline constexpr double kPi = 3.14159265358979323846;

/// A known non-negative int (joint, vertex and face numbers are int) as a subscript of a standard container.
constexpr std::size_t at(int index) { return static_cast<std::size_t>(index); }

}  // namespace anigen
