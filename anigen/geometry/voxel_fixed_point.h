#pragma once
#include <Eigen/Core>
#include <array>
#include <cmath>
#include <cstdint>

namespace anigen::geometry {

/// Voxel tests are decided in integers, so that they are exact whatever the compiler does to floating-point code: a
/// triangle that only touches a voxel counts always, not as rounding has it. Positions are rounded down to multiples of
/// 2⁻³⁰ voxel, which at 64³ keeps every single-precision coordinate beyond ±2⁻¹³ as it is.
constexpr int kFractionBits = 30;
constexpr std::int64_t kVoxelUnits = std::int64_t{1} << kFractionBits;

/// Position in units of 2⁻³⁰ voxel from the grid's corner; at most 2⁴⁰ at the largest resolution, so that a triangle's
/// plane equation (three factors of a position) fits 128 bits.
using FixedPoint = std::array<std::int64_t, 3>;
__extension__ using Int128 = __int128;

/// @pre the point lies in [-0.5, 0.5]³
inline FixedPoint to_fixed(const Eigen::Vector3d& point, int resolution) {
  const auto along = [&](Eigen::Index axis) {
    return static_cast<std::int64_t>(std::floor((point[axis] + 0.5) * resolution * static_cast<double>(kVoxelUnits)));
  };
  return {along(0), along(1), along(2)};
}

/// The nearest point of [-0.5 + 1e-6, 0.5 − 1e-6]³, as the published preparation clips vertices (reference
/// training-and-data.md, 1.1). NaN stays.
inline Eigen::Vector3d clip_to_cube(const Eigen::Vector3d& point) {
  constexpr double kEdge = 0.5 - 1e-6;
  return point.cwiseMax(-kEdge).cwiseMin(kEdge);
}

/// Rounds toward minus infinity. @pre b > 0
inline std::int64_t floor_div(std::int64_t a, std::int64_t b) {
  const std::int64_t quotient = a / b;
  return quotient * b > a ? quotient - 1 : quotient;
}

}  // namespace anigen::geometry
