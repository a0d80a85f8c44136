#pragma once
#include <filesystem>
#include <vector>

#include "anigen/loaders/files/voxel_files.h"

namespace anigen::loaders {

/// Edge of the grid that datasets on disk hold for structured latents.
constexpr int kStoredResolution = 64;

/// The voxels of a dataset on a coarser grid, for models of fewer voxels. Features merge as the published data set
/// merges them (geometry::pool_features). The published data set merges the skeleton twice when its resolution is not
/// 64, by which half of the grid stays empty; here both are merged once (reference training-and-data.md, 1.4).
/// @param resolution divides kStoredResolution, which leaves everything as it is stored
VoxelRows read_features_at(const std::filesystem::path& features, int resolution);
/// @return in file order with repetitions at kStoredResolution, else lexicographic
std::vector<geometry::Voxel> read_voxels_at(const std::filesystem::path& voxels, int resolution);

}  // namespace anigen::loaders
