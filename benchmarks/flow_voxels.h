#pragma once
#include <string>
#include <utility>
#include <vector>

#include "anigen/loaders/ragged_voxels.h"
#include "anigen/sparse/support.h"

namespace anigen::benchmarks {

/// Voxels of a dataset's file (voxels/<id>.ply), or others where no file is named.
inline sparse::SupportPtr voxels_or_ellipsoid(const std::string& file, std::vector<geometry::Voxel> otherwise,
                                              int resolution) {
  loaders::VoxelRows rows;
  rows.coords = file.empty() ? std::move(otherwise) : loaders::read_voxel_rows(file, resolution);
  return sparse::Support::create(loaders::collate_voxels({&rows}, {file}).coords, 1);
}

}  // namespace anigen::benchmarks
