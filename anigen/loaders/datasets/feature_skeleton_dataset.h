#pragma once
#include <torch/torch.h>

#include <atomic>

#include "anigen/loaders/datasets/asset_dataset.h"
#include "anigen/loaders/datasets/feature_skeleton_options.h"
#include "anigen/loaders/ragged_voxels.h"
#include "anigen/loaders/rig_batch.h"
#include "anigen/loaders/surface_cache.h"

namespace anigen::loaders {

struct FeatureSkeletonBatch : Batch {
  RaggedVoxels feats;             ///< surface voxels with their features, C = 1024 for dinov2_vitl14_reg
  RaggedVoxels feats_skl;         ///< skeleton voxels, dilated; no channels, only coords. In x, y, z order when dilated
  torch::Tensor image;            ///< [B, 3, S, S] fp32, colour in [0, 1], not multiplied by alpha
  torch::Tensor alpha;            ///< [B, S, S] fp32 in [0, 1]
  torch::Tensor extrinsics;       ///< [B, 4, 4] fp32, world → camera, OpenCV axes
  torch::Tensor intrinsics;       ///< [B, 3, 3] fp32, normalised: the picture spans [0, 1]²
  RigBatch rigs;                  ///< skin rows sum to 1, those without weight are on joint 0
  std::vector<bool> is_bad_skin;  ///< [B] column of metadata.csv
};

/// AniGenSparseFeat2Skeleton: what the structured-latent auto-encoder learns from (paper 3.3; reference
/// training-and-data.md, 1.4). Reads features, skeleton voxels, one random view and the rig of an asset; the first
/// stage needs the rig only and reads the same folders through SkinDataset.
class FeatureSkeletonDataset : public AssetDataset {
 public:
  FeatureSkeletonDataset(std::vector<AssetId> assets, const FeatureSkeletonOptions& options, std::uint64_t seed);

 private:
  struct Pack;
  std::unique_ptr<Sample> read(std::size_t asset, std::uint64_t position) const override;
  std::unique_ptr<Batch> collate(const Samples& samples, const std::vector<std::string>& ids) const override;
  std::vector<geometry::Voxel> skeleton_voxels(const AssetId& asset, std::uint64_t position) const;

  FeatureSkeletonOptions options_;
  mutable SurfaceCache surfaces_;
  mutable std::atomic<bool> told_unweighted_{false};
};

}  // namespace anigen::loaders
