#pragma once
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "anigen/core/config.h"
#include "anigen/geometry/voxel_grid.h"
#include "anigen/prepare/cleaning.h"
#include "anigen/prepare/metadata.h"
#include "anigen/prepare/pose_augmentation.h"
#include "anigen/prepare/step.h"

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

/// Rows one by one, in the file's order and with its repetitions: the order that features/<model>/<id>.npz follows.
std::vector<geometry::Voxel> read_voxel_rows(const std::filesystem::path& path, int resolution);

/// voxels/<id>.ply and voxels/<id>_skeleton.ply: the voxels that the surface touches and those that the bones cross.
class VoxelStep : public Step {
 public:
  explicit VoxelStep(int resolution) : resolution_(resolution) {}

  std::string name() const override { return "voxels"; }
  int version() const override { return 1; }
  Json options() const override { return {{"resolution", resolution_}}; }
  std::vector<std::filesystem::path> outputs(const AssetPlaces& places, const Json& options) const override;
  /// @return num_voxels, num_skeleton_voxels
  Json run(AssetJob& job) const override;

 private:
  int resolution_;
};

/// skeleton/<id>/skeleton_voxelized.npz: joints, parents, dense weights and mesh.
class SkeletonStep : public Step {
 public:
  std::string name() const override { return "skeleton"; }
  int version() const override { return 1; }
  std::vector<std::filesystem::path> outputs(const AssetPlaces& places, const Json& options) const override;
  Json run(AssetJob& job) const override;
};

/// assets/<id>.glb: the asset itself, in the dataset's frame, with every influence and animation.
class KeepAssetStep : public Step {
 public:
  std::string name() const override { return "asset"; }
  int version() const override { return 1; }
  std::vector<std::filesystem::path> outputs(const AssetPlaces& places, const Json& options) const override;
  Json run(AssetJob& job) const override;
};

/// features/<model>/<id>.npz: indices u8 [N, 3] and patchtokens f16 [N, C], rows in the order of voxels/<id>.ply.
class FeatureStep : public Step {
 public:
  FeatureStep(std::shared_ptr<const FeatureExtractor> extractor, int resolution);

  /// "features/<model>", so that one dataset can hold the features of several models.
  std::string name() const override { return "features/" + extractor_->name(); }
  int version() const override { return 1; }
  std::vector<std::string> inputs() const override;
  Json options() const override;
  std::vector<std::filesystem::path> outputs(const AssetPlaces& places, const Json& options) const override;
  /// @return channels @throws InputError when a coordinate exceeds 255 or an extractor gives another shape
  Json run(AssetJob& job) const override;

 private:
  std::shared_ptr<const FeatureExtractor> extractor_;
  int resolution_;
};

struct ViewSettings {
  std::size_t count = 0;
  int size = 512;            ///< pixels, square
  int samples_per_axis = 2;  ///< anti-aliasing
  bool geometry = false;     ///< also normals and depth
  bool front = false;        ///< conditions only: cameras in front (render::front_views) instead of all around
  std::uint64_t seed = 0;    ///< of camera positions, together with the asset's id
};

/// renders/<id>: NNN.png, transforms.json and mesh.ply, from cameras all around (reference training-and-data.md,
/// 1.1). mesh.ply is the normalised mesh that surface voxels are made of. With ViewSettings::geometry also
/// NNN_normal.png (world normals, alpha is the mask) and NNN_depth.png (16 bits, render::kDepthUnits).
class ViewStep : public Step {
 public:
  explicit ViewStep(const ViewSettings& settings) : settings_(settings) {}

  std::string name() const override { return "views"; }
  int version() const override { return 1; }
  Json options() const override;
  std::vector<std::filesystem::path> outputs(const AssetPlaces& places, const Json& options) const override;
  void clear(const AssetPlaces& places) const override;
  /// @return views
  Json run(AssetJob& job) const override;

 private:
  ViewSettings settings_;
};

/// renders_cond/<id>: NNN.png and transforms.json, from cameras of many focal lengths, for image conditions. With
/// ViewSettings::geometry also NNN_normal.png: the true normals in the form of the published normal estimator, which
/// condition its first stage (render::encode_condition_normals).
class ConditionViewStep : public Step {
 public:
  explicit ConditionViewStep(const ViewSettings& settings) : settings_(settings) {}

  std::string name() const override { return "cond_views"; }
  int version() const override { return 1; }
  Json options() const override;
  std::vector<std::filesystem::path> outputs(const AssetPlaces& places, const Json& options) const override;
  void clear(const AssetPlaces& places) const override;
  /// @return cond_views
  Json run(AssetJob& job) const override;

 private:
  ViewSettings settings_;
};

/// Steps to run on every asset.
struct StepPlan {
  /// Of step_words(). Empty: import, asset, skeleton and voxels, and whatever else has a number or a model below.
  std::vector<std::string> steps;
  bool keep_assets = true;  ///< without it, "asset" is not among the steps that an empty list means
  int resolution = 64;      ///< of voxels
  ViewSettings views, condition_views;
  FeatureOptions features;
  std::size_t variants = 0;  ///< posed variants of every asset
  PoseAugmentation poses;
  CleaningOptions cleaning;
  std::uint64_t seed = 0;  ///< of poses and cameras

  /// True when a word is among the steps, named or by default.
  bool wants(const std::string& word) const;
  /// @throws InputError naming the option: an unknown step, features without a model, sizes out of range
  void validate() const;
};

/// The words --steps knows: import, asset, augment, skeleton, voxels, views, cond_views, features.
const std::vector<std::string>& step_words();

/// For workers and for the files that say how a dataset was made.
Json to_json(const StepPlan& plan);
StepPlan step_plan_from_json(const Json& json);

struct PlannedStep {
  std::unique_ptr<Step> step;
  bool asked = true;  ///< false: only an input of another one; taken as it is when it is there
};

/// The steps after the import, each after its inputs. @param extractor for the features, null when none are wanted
std::vector<PlannedStep> planned_steps(const StepPlan& plan, std::shared_ptr<const FeatureExtractor> extractor);

/// The extractor that the plan wants; null when it wants no features. @param factory may be empty
/// @throws InputError, NotSupportedError when it cannot be made
std::shared_ptr<const FeatureExtractor> make_extractor(const StepPlan& plan, const FeatureExtractorFactory& factory);

}  // namespace anigen::prepare
