#pragma once
#include <cstdint>
#include <functional>
#include <string>

#include "anigen/nn/torch.h"
#include "anigen/shape_field/cube_field.h"
#include "anigen/shape_field/flexicubes.h"

namespace anigen::shape_field {

/// Skin features of mesh vertices from the active grid vertices nearest to them, by Gaussian weights of deviation 1.5/R
/// that add up to one (docs/reference/autoencoders.md, 5.5). Differentiable in the features only: the weights are
/// constants.
/// @param features [V, S] at field.vertices @param points [P, 3] object space @param count nearest vertices used
/// @param deformed measure to field.positions() instead of the undeformed grid @return [P, S]
Tensor interpolate_from_nearest(const CubeField& field, const Tensor& features, const Tensor& points,
                                std::int64_t count, bool deformed);

/// As above, by trilinear interpolation in the undeformed grid, zero at vertices that no active cube touches
/// (`vertex_skin_feat_interp_trilinear`). Differentiable in features and points. @return [P, S]
Tensor interpolate_trilinearly(const CubeField& field, const Tensor& features, const Tensor& points);

/// Layout of the channels of a fine voxel, as they are read and turned into a mesh (docs/reference/autoencoders.md, 4.7
/// and 5).
///
/// Skin features of mesh vertices normally pass through FlexiCubes like colours. With `skin_interp_sparse` they are
/// taken from the eight nearest active grid vertices instead; `skin_interp_nearest` (from one), `skin_interp_trilinear`
/// (from the cell, only when deformation is off) and `skin_interp_use_deformed_grid` modify that and do nothing without
/// it. `skin_nodeform_trilinear` stands for `skin_interp_sparse`, `skin_interp_trilinear` and `disable_deform`
/// together.
struct MeshFieldOptions {
  std::int64_t resolution = 256;
  bool use_color = true;
  std::int64_t skin_channels = 4;              ///< 0: no skin feature (predict_skin off)
  bool disable_deform = false;                 ///< flexicube_disable_deform
  bool skin_interp_sparse = false;             ///< vertex_skin_feat_interp_sparse
  bool skin_interp_nearest = false;            ///< vertex_skin_feat_interp_nearest
  bool skin_interp_trilinear = false;          ///< vertex_skin_feat_interp_trilinear
  bool skin_interp_use_deformed_grid = false;  ///< vertex_skin_feat_interp_use_deformed_grid
  bool skin_nodeform_trilinear = false;        ///< vertex_skin_feat_nodeform_trilinear

  /// 8 sdf + 24 deform + 21 weights + 48 colour + 8 · skin.
  std::int64_t channels() const { return 53 + (use_color ? 48 : 0) + 8 * skin_channels; }
};

struct ExtractedMesh {
  bool success = false;  ///< whether there is a surface
  Tensor vertices;       ///< [V, 3] object space
  Tensor faces;          ///< [F, 3] int64
  Tensor attributes;     ///< [V, 6]: RGB and normal map, in [0, 1]; undefined without colour
  Tensor skin_features;  ///< [V, S]; undefined without skin, and when left to skin_features_at()
  /// The averaged field, for the TSDF loss (field.positions(), field.sdf) and inspection; attributes: skin feature,
  /// then colour. Its deformation is zero when the options disable it.
  CubeField field;
  Tensor regularizer;  ///< scalar, only when training (docs/reference/training.md, 3.3)
  struct Terms {
    Tensor consistency, deviation, weights;  ///< scalars: unweighted means, only when training
  } terms;
};

/// Extent of ExtractedMesh::skin_features: a loss over a few vertices need not interpolate those of all. Features that
/// pass through FlexiCubes are there in either case.
enum class SkinFeatures { kOfAllVertices, kWhenAskedFor };

/// Channels of the fine voxels of one asset → mesh. Differentiable once in feats.
/// @param coords [C, 3] integers in [0, resolution), no voxel twice @param feats [C, options.channels()] fp32 or fp64
/// @throws InputError when shapes do not fit, or for a voxel outside the grid or twice
ExtractedMesh extract_mesh(const Tensor& coords, const Tensor& feats, const MeshFieldOptions& options, bool training,
                           SkinFeatures skin_features = SkinFeatures::kOfAllVertices);

/// Skin features of some vertices of a mesh, those that extract_mesh would give. Differentiable once.
/// @param options of the extraction @param vertices [P] int64 rows; undefined: all @return [P, S], undefined without
/// skin
Tensor skin_features_at(const ExtractedMesh& mesh, const MeshFieldOptions& options, const Tensor& vertices);

// Losses between images (docs/reference/training.md, 3.3). Pictures are [N, C, H, W], colours or encoded normals in [0,
// 1]; everything can be differentiated.

/// The 11×11 Gaussian window of SSIM, deviation 1.5 pixels, sum 1. @return [11, 11] fp32
torch::Tensor ssim_window();

/// Structural similarity (Wang et al. 2004) with that window, zeros around the picture, C1 = 0.01², C2 = 0.03² and
/// biased variances, as published: borders count. @return [N], the mean over channels and pixels
/// @throws InputError when the shapes differ
torch::Tensor ssim(const torch::Tensor& a, const torch::Tensor& b);

/// 20 log10(1 / √mse) over everything. Scalar.
torch::Tensor psnr(const torch::Tensor& a, const torch::Tensor& b);

/// Mean angle in degrees between normals encoded as (n + 1)/2; pairs with a zero normal do not count, and without any
/// other it is 0. @param a, b [M, 3]
torch::Tensor normal_angle(const torch::Tensor& a, const torch::Tensor& b);

/// A learned distance of two pictures, such as LPIPS: [N, 3, H, W] twice → any shape, of which the mean counts.
using PictureDistance = std::function<torch::Tensor(const torch::Tensor&, const torch::Tensor&)>;

struct PerceptualOptions {
  double lambda_ssim = 0.2, lambda_lpips = 0.2;
};

/// Scalars; `ssim` is 1 − SSIM. A term whose weight is 0 is undefined and costs nothing.
struct PerceptualLoss {
  torch::Tensor l1, ssim, lpips;
  torch::Tensor total;  ///< l1 + lambda_ssim · ssim + lambda_lpips · lpips
};

/// @param distance asked only when lambda_lpips is not 0 @throws InputError when shapes differ, or when LPIPS is
/// weighted and there is none
PerceptualLoss perceptual_loss(const torch::Tensor& a, const torch::Tensor& b, const PerceptualOptions& options,
                               const PictureDistance& distance);

// Targets of a decoded shape: pictures of the true mesh from the same camera, and the true depth as a
// truncated signed distance (docs/reference/training.md, 3.3).

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

/// Truncation of the signed distances of tsdf_loss(), in units of the box: 3/R.
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

}  // namespace anigen::shape_field
