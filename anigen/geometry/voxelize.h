#pragma once
#include <Eigen/Core>
#include <array>
#include <cmath>
#include <cstdint>
#include <vector>

#include "anigen/asset/mesh.h"
#include "anigen/geometry/voxel_grid.h"

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

/// The nearest point of [-0.5 + 1e-6, 0.5 − 1e-6]³, as the published preparation clips vertices
/// (docs/reference/training.md, 1.1). NaN stays.
inline Eigen::Vector3d clip_to_cube(const Eigen::Vector3d& point) {
  constexpr double kEdge = 0.5 - 1e-6;
  return point.cwiseMax(-kEdge).cwiseMin(kEdge);
}

/// Rounds toward minus infinity. @pre b > 0
inline std::int64_t floor_div(std::int64_t a, std::int64_t b) {
  const std::int64_t quotient = a / b;
  return quotient * b > a ? quotient - 1 : quotient;
}

using FixedTriangle = std::array<FixedPoint, 3>;

/// Handling of a vertex outside the cube [-0.5, 0.5]³.
enum class OutsideCube {
  kClip,   ///< every coordinate of every vertex is clipped to [-0.5 + 1e-6, 0.5 − 1e-6], as published
  kRefuse  ///< InputError naming the vertex; vertices on the cube's surface stay there
};

/// The voxels whose closed box meets a triangle, surface only (docs/reference/training.md, 1.1). Exact but for the
/// rounding of vertices to 2⁻³⁰ voxel: a triangle that touches a voxel's face, edge or corner counts for it, and a
/// triangle without area counts as the segment or point it is. Runs on all threads; the result does not depend on them.
/// Memory: R³ bits, 24 bytes per vertex and the result.
/// @param vertices [V], world frame, normalised; in double precision they are not rounded to single first
/// @param resolution R, 1 to kMaxVoxelResolution
/// @return lexicographic @throws InputError on a bad resolution, a mesh without faces, a face that refers to a missing
/// vertex, or a vertex that is not finite (whether or not a face uses it)
template <typename Vertex>  // Eigen::Vector3f or Vector3d
std::vector<Voxel> voxelize_surface(const std::vector<Vertex>& vertices, const std::vector<Triangle>& faces,
                                    int resolution, OutsideCube outside = OutsideCube::kClip);

/// The voxels that the bones of a skeleton pass through, and those its joints lie in; not dilated
/// (docs/reference/training.md, 1.1). Joints are clipped to [-0.5 + 1e-6, 0.5 − 1e-6] first.
/// @param joints [J], world frame, normalised @param parents [J], -1 for a root
/// @return lexicographic @throws InputError on a bad resolution, without joints, when lengths differ, a parent is out
/// of range, or a joint is not finite
std::vector<Voxel> voxelize_bones(const std::vector<Eigen::Vector3d>& joints, const std::vector<int>& parents,
                                  int resolution);

}  // namespace anigen::geometry
