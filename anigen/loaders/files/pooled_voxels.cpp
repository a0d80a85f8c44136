#include "anigen/loaders/files/pooled_voxels.h"

#include <utility>

#include "anigen/geometry/voxel_pooling.h"

namespace anigen::loaders {

VoxelRows read_features_at(const std::filesystem::path& features, int resolution) {
  VoxelRows rows = read_voxel_features(features);
  if (resolution == kStoredResolution) return rows;
  geometry::PooledVoxels pooled =
      geometry::pool_features(rows.coords, rows.feats, rows.channels, kStoredResolution / resolution);
  return {std::move(pooled.voxels), std::move(pooled.features), rows.channels};
}

std::vector<geometry::Voxel> read_voxels_at(const std::filesystem::path& voxels, int resolution) {
  const std::vector<geometry::Voxel> rows = read_voxel_rows(voxels, kStoredResolution);
  return resolution == kStoredResolution ? rows : geometry::pool_voxels(rows, kStoredResolution / resolution);
}

}  // namespace anigen::loaders
