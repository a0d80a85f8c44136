#pragma once
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "anigen/geometry/voxel_grid.h"
#include "anigen/loaders/metadata.h"

namespace anigen::loaders {

/// Voxels of one asset with a row of numbers each.
struct VoxelRows {
  std::vector<geometry::Voxel> coords;  ///< [N] (x, y, z), in file order
  std::vector<float> feats;             ///< [N, channels] row-major, finite
  std::size_t channels = 0;
};

/// Largest edge of a grid that a dataset may have.
constexpr int kMostResolution = 256;

/// Voxels of a PLY with voxel centres: index trunc((p + ½)·R), rows in file order, repetitions kept.
/// @throws InputError naming the row of a point outside the grid, or when there are no points
std::vector<geometry::Voxel> read_voxel_rows(const std::filesystem::path& path, int resolution);

/// `features/<model>/<id>.npz`: `indices` [N, 3], `patchtokens` [N, C] of any floating dtype.
/// @throws InputError naming file, array and index: shapes, numbers not finite, a voxel outside the 64³ grid or twice
VoxelRows read_voxel_features(const std::filesystem::path& path);

/// Two arrays of an NPZ as voxels and rows: `coords` [N, 3] and `feats` [N, C] under any names.
VoxelRows read_voxel_arrays(const std::filesystem::path& path, const std::string& coords, const std::string& feats);

/// Length of an array of an NPZ, from its header alone. @throws InputError when there is no such array
std::uint64_t count_rows(const std::filesystem::path& path, const std::string& name);

std::filesystem::path surface_voxel_path(const AssetId& asset);   ///< voxels/<id>.ply
std::filesystem::path skeleton_voxel_path(const AssetId& asset);  ///< voxels/<id>_skeleton.ply

}  // namespace anigen::loaders
