#pragma once
#include <cstddef>
#include <cstdint>
#include <vector>

#include "anigen/geometry/voxel_grid.h"

namespace anigen::features {

/// Looks up which voxels of a set lie near one another.
class VoxelNeighbours {
 public:
  /// @param voxels each inside [0, resolution)³ and there once
  /// @throws InputError naming the first voxel outside the grid, or given twice
  VoxelNeighbours(const std::vector<geometry::Voxel>& voxels, int resolution);

  /// Positions, in the list of voxels, of the members at most `radius` away along every axis; the voxel itself
  /// included. Ordered by z, then y, then x of the offset.
  std::vector<std::size_t> within(const geometry::Voxel& voxel, int radius) const;

 private:
  std::int64_t key(const geometry::Voxel& voxel) const;

  int resolution_;
  std::vector<std::pair<std::int64_t, std::size_t>> places_;  // sorted by key
};

}  // namespace anigen::features
