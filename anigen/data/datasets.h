#pragma once
#include <torch/torch.h>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "anigen/core/config.h"
#include "anigen/data/batches.h"
#include "anigen/data/latent_files.h"
#include "anigen/data/metadata.h"
#include "anigen/data/rigged_item.h"
#include "anigen/data/voxel_files.h"

namespace anigen::data {

/// Base of the published dataset classes: assets whose files are read anew for every draw (their pictures
/// and features do not fit into memory), one sample per draw, samples collated into a batch.
///
/// The published loaders replace a sample that cannot be read by a random other one without counting it. Here it is an
/// error naming file and place. With skip_broken, assets with missing files are left out at the start, and one that
/// turns out broken later is replaced by an asset chosen by (seed, position), named in the log and counted.
class AssetDataset : public BatchSource {
 public:
  struct Options {
    std::uint64_t seed = 0;
    bool skip_broken = false;
    bool bucket_by_voxels = false;  ///< ours: batches of assets of similar size
  };

  /// Draws per epoch: assets, each as often as its AssetId::repeat says.
  std::size_t size() const override { return visits_.size(); }
  std::size_t assets() const { return assets_.size(); }
  const AssetId& asset(std::size_t index) const { return assets_[index]; }
  /// The first Draw::item that stands for an asset. @param asset below assets()
  std::size_t item_of(std::size_t asset) const;
  std::unique_ptr<Batch> load(const std::vector<Draw>& draws) const final;
  std::vector<std::uint64_t> bucket_loads() const override;
  /// Assets found broken after the start: id → what is wrong.
  std::map<std::string, std::string> broken() const { return broken_.problems(); }

 protected:
  struct Sample {
    virtual ~Sample() = default;
    std::string id;
  };
  using Samples = std::vector<std::unique_ptr<Sample>>;

  /// Way in which a class finds what it needs to know of its assets before training.
  struct Files {
    /// All files a sample is read from; an InputError that it throws is the asset's problem.
    std::function<std::vector<std::filesystem::path>(const AssetId&)> of;
    /// Number of voxels of an asset whose metadata does not say; null when the class does not balance by it.
    std::function<std::uint64_t(const AssetId&)> count_voxels;
  };

  /// @throws InputError naming the first assets with missing files and how many there are
  AssetDataset(std::vector<AssetId> assets, const Options& options, const Files& files);

  /// Random choices of a sample come from Rng(seed, a purpose, position). Called from several threads.
  virtual std::unique_ptr<Sample> read(std::size_t asset, std::uint64_t position) const = 0;
  /// @param samples not empty @param ids theirs
  virtual std::unique_ptr<Batch> collate(const Samples& samples, const std::vector<std::string>& ids) const = 0;

  std::uint64_t seed() const { return options_.seed; }
  std::uint64_t voxels_of_item(std::size_t item) const { return voxels_.empty() ? 0 : voxels_[visits_[item]]; }

 private:
  std::unique_ptr<Sample> sample(const Draw& draw) const;

  Options options_;
  std::vector<AssetId> assets_;
  std::vector<std::uint64_t> voxels_;  // [assets]; empty when Files::count_voxels is null
  std::vector<std::size_t> visits_;    // draw item → asset
  mutable BrokenAssets broken_;
};

/// `dataset.args` of AniGenSparseFeat2Skeleton, all of them (docs/reference/training.md, 1.3). Rows need
/// `feature_<model>` and the column `is_bad_skin`; at most `max_num_voxels` voxels, no `is_bad_skeleton`; with
/// `filter_bad_skin` no bad skin; with `test_mode` only rows whose `is_test` equals the argument.
struct FeatureSkeletonOptions {
  SourceOptions sources;
  int image_size = 0;                         ///< edge of the view, pixels; required
  std::string model = "dinov2_vitl14_reg";    ///< folder below features/
  int resolution = 64;                        ///< edge of the voxel grid; below 64 voxels are merged when they are read
  int skl_dilation_iter = 0;                  ///< Chebyshev radius by which skeleton voxels are dilated
  bool skl_dilation_random_aug = false;       ///< see geometry::dilate_randomly
  double skl_dilation_random_aug_prob = 0.5;  ///< of that, per sample
  SupportNoise support_noise;                 ///< ours: `support_grow`, `support_drop`; training assets only
  bool load_cubvh = false;                    ///< hand out a nearest-surface solver per mesh
  bool skin_accum_as_flow = false;            ///< see accumulate_skin_as_flow
  bool bucket_by_voxels = false;              ///< ours: batches of assets with similar numbers of voxels
  std::int64_t memory_budget_mb = 8192;       ///< ours: nearest-surface solvers kept in memory

  /// @throws InputError, also for a resolution that does not divide 64
  static FeatureSkeletonOptions read(ConfigReader& reader);
};

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

/// `dataset.args` of AniGenSparseStructureLatent and its image-conditioned form (docs/reference/training.md, 1.3). Rows
/// need `ss_latent_<latent_model>`. `normalization` and `normalization_skl` as dense_latent_statistics() reads them.
struct StructureLatentOptions : LatentDatasetOptions {
  /// Decoder that turns samples into voxels for pictures; nothing here reads it. `pretrained_ss_dec`, the published
  /// name of one to download, is only warned of.
  std::string ss_dec_path, ss_dec_ckpt = "final";

  /// @throws InputError; also for normalization files that cannot be read
  static StructureLatentOptions read(ConfigReader& reader, bool image_conditioned);
};

struct StructureLatentBatch : Batch {
  torch::Tensor x_0;      ///< [B, 8, 16, 16, 16] fp32, latent of the surface's structure
  torch::Tensor x_0_skl;  ///< [B, 4, 16, 16, 16] fp32, of the skeleton's
  torch::Tensor cond;     ///< [B, 3, S, S] fp32 in [0, 1], on black; undefined when not image-conditioned
};

/// (ImageConditioned)AniGenSparseStructureLatent: what the first flow model learns to generate (paper 3.4). Reads
/// `ss_latents/<latent_model>/<id>.npz` and one random condition view.
class StructureLatentDataset : public AssetDataset {
 public:
  StructureLatentDataset(std::vector<AssetId> assets, const StructureLatentOptions& options, std::uint64_t seed);

  const StructureLatentOptions& options() const { return options_; }

 private:
  struct Latent;
  StructureLatent normalized(const std::filesystem::path& path) const;
  std::unique_ptr<Sample> read(std::size_t asset, std::uint64_t position) const override;
  std::unique_ptr<Batch> collate(const Samples& samples, const std::vector<std::string>& ids) const override;

  StructureLatentOptions options_;
  mutable PictureCache pictures_;
  mutable ReadCache<StructureLatent> latents_;
};

/// `dataset.args` of AniGenSparseStructure (docs/reference/training.md, 1.3). Rows need `voxelized`.
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

/// `dataset.args` of AniGenSLat and AniGenImageConditionedSLat (docs/reference/training.md, 1.3). Rows need
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
  /// More folders below latents/: at the voxels that a first flow sees in one view (anigen-encode slat --ss-flow),
  /// which then is the condition, or without images in the mesh. `seen_share` of the samples come from one of these
  /// where the asset is in it; held-out assets do not. At inference the second flow meets such voxels alone.
  std::vector<std::string> seen_models;
  double seen_share = 0.5;

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
/// about equally many surface voxels each (balanced_groups()).
class StructuredLatentDataset : public AssetDataset {
 public:
  StructuredLatentDataset(std::vector<AssetId> assets, const StructuredLatentOptions& options, std::uint64_t seed);

  const StructuredLatentOptions& options() const { return options_; }
  std::vector<std::vector<Draw>> split(const std::vector<Draw>& draws, std::size_t parts) const override;

 private:
  struct Latent;
  struct VoxelPair {
    VoxelRows surface, skeleton;
    std::optional<std::size_t> view;  ///< that the voxels were seen in
  };
  /// @param seen of a folder of seen_models
  VoxelPair normalized(const std::filesystem::path& path, bool seen) const;
  /// Latents of a draw, from one of seen_models or from latent_model.
  std::shared_ptr<const VoxelPair> latents_of(const AssetId& asset, std::uint64_t position) const;
  std::unique_ptr<Sample> read(std::size_t asset, std::uint64_t position) const override;
  std::unique_ptr<Batch> collate(const Samples& samples, const std::vector<std::string>& ids) const override;

  StructuredLatentOptions options_;
  mutable SurfaceCache surfaces_;
  mutable PictureCache pictures_;
  mutable ReadCache<VoxelPair> latents_;
};

/// The dataset of a config, and what its splits hold out for evaluation.
struct Datasets {
  std::shared_ptr<const BatchSource> train;
  std::shared_ptr<const BatchSource> eval;  ///< null: nothing is held out
};

/// The dataset a config `{"name": …, "args": {…}}` asks for:
///
/// | name | batches |
/// |---|---|
/// | AniGenSparseStructure | SparseStructureBatch |
/// | AniGenSparseFeat2Skeleton | FeatureSkeletonBatch (the first stage makes its SkinDataset itself) |
/// | AniGenSparseStructureLatent, ImageConditionedAniGenSparseStructureLatent | StructureLatentBatch |
/// | AniGenSLat, AniGenImageConditionedSLat | StructuredLatentBatch |
/// | AniGenMattings (ours) | MattingBatch (matting_dataset.h) |
/// | AniGenPictures (ours) | PictureBatch (picture_dataset.h) |
/// | AniGenSkinCorrections (ours) | SkinCorrectionBatch (skin_correction_dataset.h) |
///
/// @param dataset the object with name and args, which must outlive the call only @param seed of all random draws
/// @throws InputError naming file and pointer: an unknown name with the nearest known one, a bad argument, a filter
/// that leaves nothing, missing files; NotSupportedError for names the published registry lists but does not implement
Datasets make_datasets(ConfigReader dataset, std::uint64_t seed);

/// All names above.
std::vector<std::string> dataset_names();

}  // namespace anigen::data
