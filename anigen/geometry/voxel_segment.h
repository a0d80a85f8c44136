#pragma once
#include <vector>

#include "anigen/geometry/voxel_fixed_point.h"
#include "anigen/geometry/voxel_grid.h"

namespace anigen::geometry {

/// Appends the voxels that the points of a closed segment lie in, in their order along it, where a point between voxels
/// belongs to the upper one as in voxel_at. A traversal from one border to the next (Amanatides and Woo, "A fast voxel
/// traversal algorithm for ray tracing", 1987) with the crossings compared as exact fractions: the same set in both
/// directions, and through an edge or a corner of the grid exactly the voxels that contain a point of the segment.
/// @pre coordinates in [0, R · 2³⁰)
void append_segment(const FixedPoint& from, const FixedPoint& to, std::vector<Voxel>& voxels);

}  // namespace anigen::geometry
