#pragma once
#include <string>
#include <utility>
#include <vector>

#include "anigen/data/voxel_files.h"
#include "anigen/sparse/support.h"

namespace anigen::benchmarks {

/// Voxels of a dataset's file (voxels/<id>.ply), or others where no file is named.
inline sparse::SupportPtr voxels_or_ellipsoid(const std::string& file, std::vector<geometry::Voxel> otherwise,
                                              int resolution) {
  data::VoxelRows rows;
  rows.coords = file.empty() ? std::move(otherwise) : data::read_voxel_rows(file, resolution);
  return sparse::Support::create(data::collate_voxels({&rows}, {file}).coords, 1);
}

}  // namespace anigen::benchmarks
