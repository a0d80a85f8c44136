#pragma once
#include <filesystem>
#include <string>

#include "anigen/loaders/datasets/sparse_structure_dataset.h"
#include "anigen/loaders/files/latent_files.h"
#include "anigen/models/sparse_structure_runs.h"
#include "anigen/models/voxel_metrics.h"

namespace anigen::pipeline {

/// How well decoded latents give back what was encoded, the skeleton as dilated as it was encoded.
struct StructureReconstruction {
  models::VoxelAgreement shape, skeleton;
};

/// A trained sparse-structure auto-encoder at work on one asset at a time, whose voxels it sees as in its training
/// (resolution and dilation of its run's config).
class StructureCoder {
 public:
  /// @param run folder of stage 2 @param ckpt as models::find_run_model @param decodes also load the decoder
  /// @throws InputError when the run is unusable; NotSupportedError for encoders of global tokens
  StructureCoder(const std::filesystem::path& run, const std::string& ckpt, torch::Device device, bool decodes);

  const std::filesystem::path& checkpoint() const { return found_.checkpoint; }
  /// What a latent depends on besides its voxels.
  std::string fingerprint() const;

  /// The very tensors that training saw, a batch of one. @throws InputError when the asset cannot be read
  loaders::SparseStructureBatch voxels(const loaders::AssetId& asset) const;
  /// Writes `mean` and `mean_skl`, without noise. @throws InputError when they are not finite; Error when the disk
  /// refuses
  void encode(const loaders::SparseStructureBatch& voxels, const std::filesystem::path& file);
  /// @pre the decoder was loaded
  StructureReconstruction agreement(const loaders::StructureLatent& latent,
                                    const loaders::SparseStructureBatch& voxels);

 private:
  torch::Device device_;
  models::RunModel found_;
  loaders::SparseStructureOptions options_;
  models::SparseStructureEncoder encoder_;
  models::SparseStructureDecoder decoder_ = nullptr;
};

}  // namespace anigen::pipeline
