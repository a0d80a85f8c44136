#pragma once
#include <torch/torch.h>

#include "anigen/core/config_reader.h"
#include "anigen/loaders/datasets/asset_dataset.h"
#include "anigen/loaders/source_options.h"

namespace anigen::loaders {

/// `dataset.args` of AniGenSparseStructure (reference training-and-data.md, 1.4). Rows need `voxelized`.
struct SparseStructureOptions {
  SourceOptions sources;
  int resolution = 64;        ///< edge of the grids; the voxel files are read at this resolution
  int skl_dilation_iter = 0;  ///< Chebyshev radius by which skeleton voxels are dilated

  static SparseStructureOptions read(ConfigReader& reader);
};

struct SparseStructureBatch : Batch {
  torch::Tensor ss;      ///< [B, 1, R, R, R] int64, 1 where the surface passes, axes x, y, z
  torch::Tensor ss_skl;  ///< the same for the skeleton, dilated
};

/// AniGenSparseStructure: occupancy of surface and skeleton, what the sparse-structure auto-encoder learns
/// (paper 3.2.2). Reads `voxels/<id>.ply` and `voxels/<id>_skeleton.ply`.
class SparseStructureDataset : public AssetDataset {
 public:
  SparseStructureDataset(std::vector<AssetId> assets, const SparseStructureOptions& options, std::uint64_t seed);

 private:
  struct Occupancy;
  std::unique_ptr<Sample> read(std::size_t asset, std::uint64_t position) const override;
  std::unique_ptr<Batch> collate(const Samples& samples, const std::vector<std::string>& ids) const override;

  SparseStructureOptions options_;
};

}  // namespace anigen::loaders
