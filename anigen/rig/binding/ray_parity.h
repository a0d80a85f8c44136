#pragma once
#include <cstdint>
#include <vector>

#include "anigen/asset/mesh.h"
#include "anigen/geometry/voxel_fixed_point.h"
#include "anigen/rig/binding/voxel_block.h"

namespace anigen::rig {

/// Out of the six rays from the centre of each cell along the axes, how many cross the surface an odd number of times:
/// 6 inside a closed surface and 0 outside, whatever the winding of its faces; between them near holes. Which rays meet
/// a triangle is decided in integers with a rule for rays through edges and vertices, so that no ray slips between two
/// triangles; where along the ray is rounded, which matters only in cells that the surface passes through.
/// Runs on one thread. Memory: two bytes per cell.
/// @param points in the grid's fixed point @param faces of points
/// @return [cells] @pre the block covers the surface
std::vector<std::uint8_t> odd_rays(const std::vector<geometry::FixedPoint>& points, const std::vector<Triangle>& faces,
                                   const VoxelBlock& block);

}  // namespace anigen::rig
