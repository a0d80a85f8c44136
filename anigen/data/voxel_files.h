#pragma once
#include <torch/torch.h>
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "anigen/core/random.h"
#include "anigen/data/metadata.h"
#include "anigen/geometry/voxel_grid.h"

namespace anigen::data {

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

/// Two arrays of an NPZ as voxels and rows: `coords` [N, 3] and `feats` [N, C] under any names.
VoxelRows read_voxel_arrays(const std::filesystem::path& path, const std::string& coords, const std::string& feats);

/// Length of an array of an NPZ, from its header alone. @throws InputError when there is no such array
std::uint64_t count_rows(const std::filesystem::path& path, const std::string& name);

std::filesystem::path surface_voxel_path(const AssetId& asset);   ///< voxels/<id>.ply
std::filesystem::path skeleton_voxel_path(const AssetId& asset);  ///< voxels/<id>_skeleton.ply

/// Edge of the grid that datasets on disk hold for structured latents.
constexpr int kStoredResolution = 64;

/// The voxels of a dataset on a coarser grid, for models of fewer voxels. Features merge as the published data set
/// merges them (geometry::pool_features). The published data set merges the skeleton twice when its resolution is not
/// 64, by which half of the grid stays empty; here both are merged once (docs/reference/training.md, 1.3).
/// @param resolution divides kStoredResolution, which leaves everything as it is stored
VoxelRows read_features_at(const std::filesystem::path& features, int resolution);
/// @return in file order with repetitions at kStoredResolution, else lexicographic
std::vector<geometry::Voxel> read_voxels_at(const std::filesystem::path& voxels, int resolution);

/// Changes of a surface's voxels, ours: a first stage gives voxels that lie beside the surface, and leaves some out. An
/// auto-encoder that has learned from such voxels decodes the surface from them.
struct SupportNoise {
  double grow = 0.0;  ///< largest share of the voxels beside a face of one that are added, [0, 1]
  double drop = 0.0;  ///< largest share of the voxels that are left out then, [0, 1)

  bool any() const { return grow > 0.0 || drop > 0.0; }
};

/// Draws both shares uniformly up to their largest, then every voxel by itself. One that is added has the features of
/// the voxel it lies beside. At least one voxel stays.
/// @param resolution of the grid, outside of which nothing is added
/// @param foot_channels 3 where the first three channels are the way from the voxel's centre to the surface in edges of
/// a grid of kStoredResolution (vision/surface_features.h), which then counts from the added one's centre; else 0
VoxelRows with_support_noise(const VoxelRows& rows, int resolution, const SupportNoise& noise,
                             std::size_t foot_channels, Rng& rng);

/// Voxels of several assets, one asset after the other: what the sparse models take (docs/reference/training.md, 1.3).
struct RaggedVoxels {
  torch::Tensor coords;               ///< [ΣN, 4] int32: asset in the batch, x, y, z
  torch::Tensor feats;                ///< [ΣN, C] fp32; C = 0 where only places count
  std::vector<std::int64_t> lengths;  ///< N of each asset
};

/// @param rows one per asset @param ids of the assets, for messages
/// @throws InputError naming the asset whose number of channels differs from the first one's
RaggedVoxels collate_voxels(const std::vector<const VoxelRows*>& rows, const std::vector<std::string>& ids);

/// A tensor of its own from as many numbers as the shape holds. Filled by the calling thread alone: loading threads
/// must not each start a team of threads.
torch::Tensor tensor_of(const std::vector<float>& values, torch::IntArrayRef shape);

/// [B, shape…] from one list of numbers per asset. @throws InputError naming the asset whose list is longer or shorter
/// @param what of an asset, for messages
torch::Tensor stack(const std::vector<const std::vector<float>*>& values, std::vector<std::int64_t> shape,
                    const std::vector<std::string>& ids, const std::string& what);

}  // namespace anigen::data
