#pragma once
#include <array>

#include "anigen/geometry/voxel_bits.h"
#include "anigen/geometry/voxel_fixed_point.h"

namespace anigen::geometry {

using FixedTriangle = std::array<FixedPoint, 3>;

/// Inserts every voxel whose closed box has a point in common with the closed triangle, which may have no area. Exact:
/// by the separating-axis theorem they meet unless the boxes' face normals, the triangle's plane or one of the nine
/// edge × axis directions separates them. Each of these 13 tests allows an interval of z for a given x and y (Schwarz
/// and Seidel, "Fast parallel surface and solid voxelization on GPUs", 2010, test voxels one by one), so a column's
/// voxels are the common part of the intervals and nothing else is looked at.
/// @pre coordinates in [0, R · 2³⁰]
void insert_triangle(const FixedTriangle& triangle, VoxelBits& voxels);

}  // namespace anigen::geometry
