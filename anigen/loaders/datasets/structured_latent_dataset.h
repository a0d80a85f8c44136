#pragma once
#include <torch/torch.h>

#include <string>

#include "anigen/core/config_reader.h"
#include "anigen/loaders/datasets/asset_dataset.h"
#include "anigen/loaders/datasets/latent_dataset_options.h"
#include "anigen/loaders/ragged_voxels.h"
#include "anigen/loaders/rig_batch.h"
#include "anigen/loaders/surface_cache.h"

namespace anigen::loaders {

/// `dataset.args` of AniGenSLat and AniGenImageConditionedSLat (reference training-and-data.md, 1.4). Rows need
/// `latent_<latent_model>`. `normalization` as structured_latent_statistics() reads it. `max_num_voxels` has no effect
/// in the published class and none here; `voxel_limit` is what it seems to promise.
struct StructuredLatentOptions : LatentDatasetOptions {
  bool use_joint_num_cond = false;                     ///< also hand out the number of joints
  bool load_cubvh = false;                             ///< hand out a nearest-surface solver per mesh; needs the rigs
  std::string slat_dec_path, slat_dec_ckpt = "final";  ///< decoder for pictures; nothing here reads it
  // Ours.
  bool load_rigs = true;                 ///< read the rig of every sample, as published; training the flow needs none
  std::int64_t voxel_limit = 0;          ///< leave out assets whose column num_voxels says more; 0: none
  bool bucket_by_voxels = false;         ///< batches of assets with similar numbers of voxels
  std::int64_t memory_budget_mb = 8192;  ///< nearest-surface solvers kept in memory

  /// @throws InputError; also for a normalization file that cannot be read
  static StructuredLatentOptions read(ConfigReader& reader, bool image_conditioned);
};

struct StructuredLatentBatch : Batch {
  RaggedVoxels x_0;          ///< surface voxels, C = 16: geometry 8, skin 8
  RaggedVoxels x_0_skl;      ///< skeleton voxels, C = 4
  RigBatch rigs;             ///< skin as stored: neither repaired nor divided by row sums; empty without load_rigs
  torch::Tensor joints_num;  ///< [B] int64; undefined without use_joint_num_cond
  torch::Tensor cond;        ///< [B, 3, S, S] fp32 in [0, 1], on black; undefined when not image-conditioned
};

/// AniGenSLat and AniGenImageConditionedSLat: what the second flow model learns to generate (paper 3.4). Reads
/// `latents/<latent_model>/<id>.npz`, the rig, if wanted, and one random condition view. A step's micro-batches hold
/// about equally many surface voxels each (balanced_groups.h).
class StructuredLatentDataset : public AssetDataset {
 public:
  StructuredLatentDataset(std::vector<AssetId> assets, const StructuredLatentOptions& options, std::uint64_t seed);

  const StructuredLatentOptions& options() const { return options_; }
  std::vector<std::vector<Draw>> split(const std::vector<Draw>& draws, std::size_t parts) const override;

 private:
  struct Latent;
  std::unique_ptr<Sample> read(std::size_t asset, std::uint64_t position) const override;
  std::unique_ptr<Batch> collate(const Samples& samples, const std::vector<std::string>& ids) const override;

  StructuredLatentOptions options_;
  mutable SurfaceCache surfaces_;
};

}  // namespace anigen::loaders
