#pragma once
#include <cstddef>
#include <vector>

#include "anigen/geometry/voxel_grid.h"

namespace anigen::geometry {

struct PooledVoxels {
  std::vector<Voxel> voxels;    ///< at resolution R / factor, lexicographic
  std::vector<float> features;  ///< row-major [voxels, channels]
};

/// The coarser voxels that contain the given ones.
/// @param voxels in any order @throws InputError unless factor ≥ 1
std::vector<Voxel> pool_voxels(const std::vector<Voxel>& voxels, int factor);

/// Merges the voxels of each factor³ block. A block of n voxels gets Σ features / (n + 1): the published pooling
/// averages the zero it starts from as well, which shrinks a lone voxel's features by half (reference
/// training-and-data.md, 1.4, resolution other than 64).
/// @param features row-major [voxels, channels] @throws InputError when lengths differ or factor < 1
PooledVoxels pool_features(const std::vector<Voxel>& voxels, const std::vector<float>& features, std::size_t channels,
                           int factor);

}  // namespace anigen::geometry
