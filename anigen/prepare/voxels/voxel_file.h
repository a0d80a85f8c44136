#pragma once
#include <filesystem>
#include <vector>

#include "anigen/geometry/voxel_grid.h"

namespace anigen::prepare {

/// `voxels/<id>.ply` and `voxels/<id>_skeleton.ply` of the published data set (reference training-and-data.md, 1.1):
/// binary PLY, little-endian, one element `vertex` with float x, y, z, the centres of the voxels. Equal sets give equal
/// bytes: rows are in lexicographic order. Atomic.
/// @param voxels in any order @param resolution R
/// @throws InputError without voxels, on a bad resolution, or when a voxel lies outside the grid
void write_voxel_ply(const std::filesystem::path& path, std::vector<geometry::Voxel> voxels, int resolution);

/// The voxels of such a file, ours or another program's (any PLY with x, y, z), as a set.
/// @throws InputError naming the file, and the row of a point that is in no voxel
std::vector<geometry::Voxel> read_voxel_ply(const std::filesystem::path& path, int resolution);

/// The same row by row, in the file's order and with its repetitions: the order that features/<model>/<id>.npz follows.
std::vector<geometry::Voxel> read_voxel_rows(const std::filesystem::path& path, int resolution);

}  // namespace anigen::prepare
