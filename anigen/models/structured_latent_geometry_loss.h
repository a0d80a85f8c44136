#pragma once
#include <cstdint>
#include <string>

#include "anigen/models/image_loss.h"

namespace anigen::models {

// What a decoded shape is compared with: pictures of the true mesh from the same camera, and the true depth as a
// truncated signed distance (reference training-and-data.md, 3.3, geo_loss and color_loss).

/// Arguments of the published trainer, names and defaults.
struct GeometryLossOptions {
  bool smooth_depth = false;  ///< depth_loss_type "smooth_l1" instead of "l1"
  double lambda_depth = 1.0, lambda_tsdf = 0.01;
  double lambda_color = 0.0;  ///< of colours and of a predicted normal map
  PerceptualOptions perceptual;
  std::int64_t resolution = 256;  ///< R of the fine grid, sets the truncation 3/R and the smooth range 1/(2R)
  /// The published colour loss holds the L1 distance twice, once without lambda_color: a term of the same name
  /// overwrites the sum it is added to. False: once.
  bool extra_color_l1 = true;

  /// `depth_loss_type` from its published word. @throws InputError on another
  void set_depth_loss(const std::string& word);
};

/// Points as a camera sees them. @param points [M, 3] world @param extrinsics [4, 4] world → camera, OpenCV axes
/// @param intrinsics [3, 3] normalised: the picture spans [0, 1]²
struct ProjectedPoints {
  torch::Tensor uv;     ///< [M, 2], (0, 0) the top left
  torch::Tensor depth;  ///< [M] camera z
};
ProjectedPoints project_points(const torch::Tensor& points, const torch::Tensor& extrinsics,
                               const torch::Tensor& intrinsics);

/// Where the signed distances of tsdf_loss() are cut off, in units of the box: 3/R.
double tsdf_truncation(std::int64_t resolution);

/// Mean over the grid points in front of the truncation of (s − clamp(q, ±3/R))², q = true depth − the point's depth;
/// the true depth is read bilinearly with pixel corners aligned, as published. No gradient reaches the points; 0 where
/// no point counts. @param points [M, 3] @param sdf [M] @param depth [H, W] of the true mesh, background 0 @return
/// scalar
torch::Tensor tsdf_loss(const torch::Tensor& points, const torch::Tensor& sdf, const torch::Tensor& depth,
                        const torch::Tensor& extrinsics, const torch::Tensor& intrinsics, std::int64_t resolution);

/// Normals turned towards the camera, every pixel along its own ray. @param normal [N, 3, H, W] world, as (n + 1)/2
/// @param extrinsics [N, 4, 4] @param intrinsics [N, 3, 3] @return as normal
torch::Tensor facing_camera(const torch::Tensor& normal, const torch::Tensor& extrinsics,
                            const torch::Tensor& intrinsics);

/// Pictures of N shapes.
struct SurfacePictures {
  torch::Tensor mask, depth;  ///< [N, 1, H, W]: coverage; camera z, background 0
  torch::Tensor normal;       ///< [N, 3, H, W] as (n + 1)/2
  torch::Tensor normal_map;   ///< [N, 3, H, W] of the vertices; undefined: none
};

/// Scalars under the published names; ssim as 1 − SSIM. Terms that were not asked for are undefined.
struct GeometryLosses {
  torch::Tensor tsdf, mask, depth, normal, normal_ssim, normal_perceptual, normal_map_perceptual;
  torch::Tensor total;  ///< geo_loss
};
/// @param truth its normals already facing_camera(); only what its mask covers is compared
/// @param tsdf mean of tsdf_loss() over the shapes; undefined: none
/// @throws InputError as perceptual_loss
GeometryLosses geometry_losses(const SurfacePictures& predicted, const SurfacePictures& truth,
                               const torch::Tensor& tsdf, const GeometryLossOptions& options,
                               const PictureDistance& distance = nullptr);

/// color_loss. @param color [N, 3, H, W] rendered @param image [N, 3, H, W] not multiplied by alpha
/// @param alpha [N, H, W] @return scalar
torch::Tensor color_loss(const torch::Tensor& color, const torch::Tensor& image, const torch::Tensor& alpha,
                         const GeometryLossOptions& options, const PictureDistance& distance = nullptr);

}  // namespace anigen::models
