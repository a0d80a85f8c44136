#include "anigen/models/structured_latent_geometry_loss.h"

#include <vector>

#include "anigen/core/error.h"

namespace anigen::models {
namespace {

using torch::Tensor;

constexpr double kTruncationCells = 3.0;

Tensor depth_difference(const Tensor& a, const Tensor& b, const GeometryLossOptions& options) {
  if (!options.smooth_depth) return (a - b).abs().mean();
  return at::smooth_l1_loss(a, b, at::Reduction::Mean, 0.5 / static_cast<double>(options.resolution));
}

// Picture coordinates of the pixel centres with a third coordinate 1, [H·W, 3].
Tensor pixel_centers(std::int64_t height, std::int64_t width, const torch::TensorOptions& options) {
  const Tensor y = (torch::arange(height, options) + 0.5) / static_cast<double>(height);
  const Tensor x = (torch::arange(width, options) + 0.5) / static_cast<double>(width);
  const Tensor u = x.unsqueeze(0).expand({height, width}).reshape({-1});
  const Tensor v = y.unsqueeze(1).expand({height, width}).reshape({-1});
  return torch::stack({u, v, torch::ones_like(u)}, 1);
}

}  // namespace

void GeometryLossOptions::set_depth_loss(const std::string& word) {
  if (word != "l1" && word != "smooth_l1") {
    throw InputError("", "depth_loss_type", "expected l1 or smooth_l1, found '" + word.substr(0, 80) + "'");
  }
  smooth_depth = word == "smooth_l1";
}

ProjectedPoints project_points(const Tensor& points, const Tensor& extrinsics, const Tensor& intrinsics) {
  const Tensor rotation = extrinsics.slice(0, 0, 3).slice(1, 0, 3);
  const Tensor translation = extrinsics.slice(0, 0, 3).select(1, 3);
  const Tensor camera = torch::matmul(points, rotation.t()) + translation;
  const Tensor projected = torch::matmul(camera, intrinsics.t());
  return {projected.slice(1, 0, 2) / projected.slice(1, 2, 3), camera.select(1, 2)};
}

double tsdf_truncation(std::int64_t resolution) { return kTruncationCells / static_cast<double>(resolution); }

Tensor tsdf_loss(const Tensor& points, const Tensor& sdf, const Tensor& depth, const Tensor& extrinsics,
                 const Tensor& intrinsics, std::int64_t resolution) {
  const double truncation = tsdf_truncation(resolution);
  Tensor target, counts;
  {
    const torch::NoGradGuard no_grad;
    const ProjectedPoints seen = project_points(points.detach(), extrinsics, intrinsics);
    const Tensor grid = (2.0 * seen.uv - 1.0).view({1, 1, -1, 2});
    constexpr std::int64_t kBilinear = 0, kBorder = 1;
    const Tensor surface =
        at::grid_sampler(depth.reshape({1, 1, depth.size(0), depth.size(1)}), grid, kBilinear, kBorder, true);
    const Tensor signed_distance = surface.reshape({-1}) - seen.depth;
    counts = signed_distance > -truncation;
    target = signed_distance.clamp(-truncation, truncation);
  }
  const Tensor error = torch::where(counts, (sdf - target).square(), torch::zeros_like(sdf));
  return error.sum() / counts.sum().clamp_min(1).to(error.scalar_type());
}

Tensor facing_camera(const Tensor& normal, const Tensor& extrinsics, const Tensor& intrinsics) {
  const std::int64_t items = normal.size(0), height = normal.size(2), width = normal.size(3);
  const Tensor rotation = extrinsics.slice(1, 0, 3).slice(2, 0, 3);
  const Tensor pixels = pixel_centers(height, width, normal.options());
  // Row vectors: K⁻¹ and then Rᵀ, which takes directions from the camera to the world.
  const Tensor rays = torch::matmul(torch::matmul(pixels, at::linalg_inv(intrinsics).transpose(1, 2)), rotation);
  const Tensor along = rays.transpose(1, 2).reshape({items, 3, height, width});
  const Tensor n = 2.0 * normal - 1.0;
  const Tensor towards = (n * along).sum(1, /*keepdim=*/true) < 0;
  return (torch::where(towards, n, -n) + 1.0) / 2.0;
}

GeometryLosses geometry_losses(const SurfacePictures& predicted, const SurfacePictures& truth, const Tensor& tsdf,
                               const GeometryLossOptions& options, const PictureDistance& distance) {
  GeometryLosses losses;
  losses.mask = (predicted.mask - truth.mask).abs().mean();
  losses.depth = depth_difference(predicted.depth * truth.mask, truth.depth * truth.mask, options);
  const PerceptualLoss normal =
      perceptual_loss(predicted.normal * truth.mask, truth.normal * truth.mask, options.perceptual, distance);
  losses.normal = normal.l1;
  losses.normal_ssim = normal.ssim;
  losses.normal_perceptual = normal.total;
  losses.total = losses.mask + options.lambda_depth * losses.depth + losses.normal_perceptual;
  if (tsdf.defined()) {
    losses.tsdf = tsdf;
    losses.total = losses.total + options.lambda_tsdf * tsdf;
  }
  if (predicted.normal_map.defined() && truth.normal_map.defined()) {
    losses.normal_map_perceptual =
        perceptual_loss(truth.normal_map, predicted.normal_map, options.perceptual, distance).total;
    losses.total = losses.total + options.lambda_color * losses.normal_map_perceptual;
  }
  return losses;
}

Tensor color_loss(const Tensor& color, const Tensor& image, const Tensor& alpha, const GeometryLossOptions& options,
                  const PictureDistance& distance) {
  const PerceptualLoss loss = perceptual_loss(image * alpha.unsqueeze(1), color, options.perceptual, distance);
  const Tensor weighted = options.lambda_color * loss.total;
  return options.extra_color_l1 ? loss.l1 + weighted : weighted;
}

}  // namespace anigen::models
