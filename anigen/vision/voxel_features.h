#pragma once
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "anigen/geometry/voxel_grid.h"
#include "anigen/nn/torch.h"
#include "anigen/prepare/metadata.h"
#include "anigen/vision/dinov2.h"

namespace anigen::vision {

/// Projections of points into views: uv = π(K (E p)), scaled from [0, 1] to [-1, 1]; (-1, -1) is the top left corner of
/// the picture (docs/reference/training.md, 1.1).
/// @param points [N, 3], world frame @param extrinsics [V, 4, 4] world → camera (OpenCV)
/// @param intrinsics [V, 3, 3] for a picture of width and height 1 @return [V, N, 2]; points in the plane of the eye
///   give values that are not finite
Tensor project_points(const Tensor& points, const Tensor& extrinsics, const Tensor& intrinsics);

/// The patch features that points see: bilinear between patch centres, zero outside the picture; neither occlusion nor
/// the side of the camera is tested, as published.
/// @param patches [V, rows·columns, C], row by row @param uv [V, N, 2] of project_points
/// @return [V, N, C]
Tensor sample_patches(const Tensor& patches, std::int64_t rows, std::int64_t columns, const Tensor& uv);

/// The plain mean over all views, those that show nothing included. Views are added one by one, in fp32, so the result
/// does not depend on how they were batched.
class ViewMean {
 public:
  /// @param per_view [V, N, C]
  void add(const Tensor& per_view);
  std::int64_t views() const { return views_; }
  /// [N, C] fp32. At least one view must have been added.
  Tensor mean() const;

 private:
  Tensor sum_;
  std::int64_t views_ = 0;
};

/// Looks up which voxels of a set lie near one another.
class VoxelNeighbours {
 public:
  /// @param voxels each inside [0, resolution)³ and there once
  /// @throws InputError naming the first voxel outside the grid, or given twice
  VoxelNeighbours(const std::vector<geometry::Voxel>& voxels, int resolution);

  /// Positions, in the list of voxels, of the members at most `radius` away along every axis; the voxel itself
  /// included. Ordered by z, then y, then x of the offset.
  std::vector<std::size_t> within(const geometry::Voxel& voxel, int radius) const;

 private:
  std::int64_t key(const geometry::Voxel& voxel) const;

  int resolution_;
  std::vector<std::pair<std::int64_t, std::size_t>> places_;  // sorted by key
};

/// DINOv2 patch features averaged over the views of an asset (docs/reference/training.md, 1.1): every view is resized
/// to 518², put on black and encoded; each voxel's centre is projected into it and reads the patch tokens before the
/// final norm, bilinearly; views in which it lies outside the picture count as zero.
class DinoFeatures : public prepare::FeatureExtractor {
 public:
  /// @param name a published model (vision::Dinov2Options::names) @param weights .pth, .pt or .safetensors
  /// @param device "cpu", "cuda" or "cuda:N" @throws InputError as load_dinov2_weights, or for a device that is not
  /// there
  DinoFeatures(const std::string& name, const std::filesystem::path& weights, const std::string& device = "cpu");
  /// A model of any size under a name of one's own: tests and ablations.
  /// @param image_size pixels to which views are resized, a multiple of the patch size
  DinoFeatures(std::string name, std::string fingerprint, Dinov2 model, int image_size);

  std::string name() const override { return name_; }
  /// Names the weights by their SHA-256.
  std::string fingerprint() const override { return fingerprint_; }
  int channels() const override { return static_cast<int>(model_->options().embed_dim); }
  bool needs_views() const override { return true; }
  /// Memory: the model, three arrays of fp32 [N, C], and the batches' attention scores (256 MiB on a CPU, 2 GiB else).
  /// @throws InputError naming the view that is missing or damaged, or as read_transforms
  io::NdArray extract(const prepare::FeatureRequest& request) const override;

 private:
  torch::Tensor encode(const torch::Tensor& images) const;  // [V, 3, S, S] in [0, 1] → [V, P, C]

  std::string name_, fingerprint_;
  mutable Dinov2 model_ = nullptr;  // forward() of a torch module is never const
  int image_size_;
};

/// Names for `--features`: "surface" and the published DINOv2 models.
std::vector<std::string> feature_models();

/// The extractor that the options name (a prepare::FeatureExtractorFactory).
/// @throws InputError for an unknown name (naming the nearest), for a DINOv2 model without weights (saying how to give
///   them), for weights given to `surface`, and for weights that do not fit
std::unique_ptr<prepare::FeatureExtractor> make_feature_extractor(const prepare::FeatureOptions& options);

}  // namespace anigen::vision
