#pragma once
#include <functional>
#include <vector>

#include "anigen/rig/binding/moving_bones.h"
#include "anigen/rig/binding/voxel_block.h"

namespace anigen::rig {

/// Visits the cells of the block that a line touches, slab by slab along its longest axis from its start to its end;
/// a line on the border of cells touches those on both sides, so that a symmetric rig stays symmetric. In a slab also
/// cells are visited that the line misses by less than a cell. Cells that lie outside the block are left out.
/// @param line in the unit frame
/// @param visit gets the cells of one slab, none twice; false ends the walk
void walk_line(const VoxelBlock& block, const BoneLine& line,
               const std::function<bool(const std::vector<std::uint32_t>&)>& visit);

}  // namespace anigen::rig
