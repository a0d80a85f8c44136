#pragma once
#include <array>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "anigen/asset/rigged_asset.h"
#include "anigen/core/job.h"

namespace anigen::engine {

/// Options of a dataset, as those of anigen-prepare (docs/own_data.md).
struct PrepareOptions {
  std::size_t creatures = 0;      ///< procedural ones, beside the inputs
  std::size_t poses = 0;          ///< posed variants of every asset
  std::string cleaning = "none";  ///< none, anymate, articulation-xl
  bool keep_assets = true;        ///< assets/<id>.glb
  int resolution = 64;            ///< R of the voxel grid, 2 … 1024
  // Pictures of every asset, from all around and as image conditions.
  std::size_t views = 0, condition_views = 0;
  int view_size = 512, condition_view_size = 1024;  ///< pixels, 8 … 4096
  bool front_cameras = false;                       ///< condition views within 60 degrees of the front
  bool view_geometry = false;                       ///< also normals and depth
  std::string features;  ///< of surface voxels: surface, dinov2_vits14_reg, …; empty: none. Needs LibTorch
  std::filesystem::path feature_weights;  ///< of a network
  std::optional<double> test_fraction;    ///< 0 … 1; unset: the flags of the source, else 0.333
  std::uint64_t seed = 0;                 ///< of split, poses, cameras, creatures
};

/// A source that is not in the dataset.
struct RejectedSource {
  std::string source, reason;
  std::string step;  ///< that it failed at, such as "import"
};

/// Counts of a dataset.
struct PreparedDataset {
  std::size_t assets = 0, variants = 0;           ///< sources that are in it, posed variants of them
  std::size_t reused = 0;                         ///< sources for which an earlier call had made everything
  std::size_t train = 0, test = 0, unusable = 0;  ///< assets in the splits, and in none
  std::size_t failed_steps = 0;                   ///< failures.jsonl names them
  std::uintmax_t bytes = 0;
  std::vector<RejectedSource> rejected;
};

/// Turns rigged files, published datasets and creatures into the dataset that anigen-prepare makes of them, byte for
/// byte; a call that was cancelled or killed goes on where it stopped. Works on the threads of this process: without
/// the limits of time and memory that the program's worker processes have.
/// @param inputs files and folders; .glb .gltf .fbx .dae, obj with rig text, NPZ and Anymate shards @param out folder
/// @throws InputError for an option out of range, an input that cannot be read, when no source could be used, or while
/// somebody else prepares other sources there; WriteError; Interrupted
PreparedDataset prepare(const std::vector<std::filesystem::path>& inputs, const std::filesystem::path& out,
                        const PrepareOptions& options = {}, Job* job = nullptr);

/// A voxel of the R³ grid over [-0.5, 0.5]³: x, y, z in [0, R).
using VoxelIndex = std::array<std::int32_t, 3>;

/// A training example in memory.
struct PreparedAsset {
  Asset asset;         ///< its box centred, longest side 1, Z up; cleaned
  double scale = 1.0;  ///< asset = scale · original + offset
  Eigen::Vector3d offset = Eigen::Vector3d::Zero();
  std::vector<VoxelIndex> voxels;           ///< that the surface touches, x, y, z ascending
  std::vector<VoxelIndex> skeleton_voxels;  ///< that bones pass through
  std::vector<std::string> findings;        ///< what cleaning changed, a sentence each
  bool usable = true;                       ///< the splits of a dataset would take it
};

/// Makes of one rigged asset what a dataset holds of it. @param options cleaning and resolution count
/// @throws InputError for an asset that is unsound, has no skin, or that a rule of cleaning drops; Interrupted
PreparedAsset prepare(const Asset& asset, const PrepareOptions& options = {}, Job* job = nullptr);

}  // namespace anigen::engine
