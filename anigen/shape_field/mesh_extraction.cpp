#include "anigen/shape_field/mesh_extraction.h"

#include <ATen/Dispatch.h>
#include <ATen/Parallel.h>
#include <algorithm>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/core/kernel_form.h"
#include "anigen/nn/init.h"
#include "anigen/shape_field/grid.h"

namespace anigen::shape_field {

namespace {

constexpr double kGaussianCells = 1.5;
constexpr double kLeastGaussianSum = 1e-12;

// Rows of grid places in the field; the number of vertices, one past the end, where there is none. @param places [P, 3]
Tensor rows_of_places(const CubeField& field, const Tensor& places) {
  const std::int64_t side = field.resolution + 1;
  const auto numbers = [&](const Tensor& p) {
    const std::vector<Tensor> axis = p.to(torch::kInt64).unbind(1);
    return (axis[0] * side + axis[1]) * side + axis[2];
  };
  const Tensor known = numbers(field.vertices), wanted = numbers(places);
  const Tensor row = torch::searchsorted(known, wanted);
  const Tensor found = known.index_select(0, row.clamp_max(known.size(0) - 1)).eq(wanted);
  return row.masked_fill(found.logical_not(), known.size(0));
}

void require_points(const CubeField& field, const Tensor& features, const Tensor& points) {
  TORCH_CHECK(
      features.dim() == 2 && features.size(0) == field.vertices.size(0) && points.dim() == 2 && points.size(1) == 3,
      "features ", features.sizes(), " of ", field.vertices.size(0), " vertices at points ", points.sizes());
}

constexpr std::int64_t kColorChannels = 6;  // RGB, normal map
constexpr double kDeviationFactor = 0.5, kWeightsFactor = 0.2;
constexpr std::int64_t kNearVertices = 8;

bool deform_disabled(const MeshFieldOptions& options) {
  return options.disable_deform || options.skin_nodeform_trilinear;
}

// The layout of docs/reference/autoencoders.md, 4.7. Attributes are the skin feature, then the colours.
CubeCorners split_channels(const Tensor& coords, const Tensor& feats, const MeshFieldOptions& options) {
  const std::int64_t cubes = feats.size(0), colors = options.use_color ? kColorChannels : 0;
  // The backward pass of a split is one concatenation, that of each range by itself a sum over all channels.
  const std::vector<Tensor> parts =
      feats.split_with_sizes({8, 24, kCubeWeights, 8 * colors, 8 * options.skin_channels}, 1);
  CubeCorners corners;
  corners.coords = coords;
  corners.sdf = parts[0] - 1.0 / static_cast<double>(options.resolution);
  corners.deform = parts[1].view({cubes, 8, 3});
  corners.weights = parts[2];
  const Tensor color = torch::sigmoid(parts[3]).view({cubes, 8, colors});
  corners.attributes = torch::cat({parts[4].view({cubes, 8, options.skin_channels}), color}, 2);
  return corners;
}

// Field of predicted rows and the two regularisers of its corners.
PredictedField field_of(const Tensor& coords, const Tensor& feats, const MeshFieldOptions& options) {
  if (feats.is_cpu()) {
    const CornerLayout layout{options.use_color ? kColorChannels : 0, options.skin_channels};
    return predicted_field(coords, feats, layout, options.resolution);
  }
  const CubeCorners corners = split_channels(coords, feats, options);
  PredictedField predicted;
  predicted.field = average_corners(corners, options.resolution);
  predicted.consistency = corner_consistency(corners, predicted.field);
  const Tensor weights = corners.weights.narrow(1, 0, kRegularWeights).abs();
  predicted.weights_length = weights.numel() > 0 ? weights.mean() : weights.sum();
  return predicted;
}

using torch::autograd::AutogradContext;
using torch::autograd::variable_list;

// Σ_k w_pk f_{r_pk}, in one pass and without the [P, K, S] chosen features. Entries are added in order, p first.
class WeightedRows : public torch::autograd::Function<WeightedRows> {
 public:
  // @param features [V, S] @param rows [P, K] int64 @param weights [P, K], constants @return [P, S]
  static Tensor forward(AutogradContext* context, const Tensor& features, const Tensor& rows, const Tensor& weights) {
    context->save_for_backward({rows, weights});
    context->saved_data["rows"] = features.size(0);
    const Tensor table = features.contiguous();
    const Tensor out = torch::zeros({rows.size(0), table.size(1)}, table.options());
    AT_DISPATCH_FLOATING_TYPES(table.scalar_type(), "weighted_rows", [&] {
      const scalar_t* feature = table.data_ptr<scalar_t>();
      scalar_t* sum = out.data_ptr<scalar_t>();
      const std::int64_t channels = table.size(1), count = rows.size(1);
      for_entries<scalar_t>(rows, weights, [&](std::int64_t entry, std::int64_t row, scalar_t weight) {
        for (std::int64_t c = 0; c < channels; ++c)
          sum[entry / count * channels + c] += weight * feature[row * channels + c];
      });
    });
    return out;
  }
  static variable_list backward(AutogradContext* context, variable_list gradients) {
    const variable_list saved = nn::saved_once(*context, "the interpolation of skin features");
    const Tensor &rows = saved[0], &weights = saved[1], d_out = gradients[0].contiguous();
    const Tensor out = torch::zeros({context->saved_data["rows"].toInt(), d_out.size(1)}, d_out.options());
    AT_DISPATCH_FLOATING_TYPES(d_out.scalar_type(), "weighted_rows_backward", [&] {
      const scalar_t* d_sum = d_out.data_ptr<scalar_t>();
      scalar_t* d_feature = out.data_ptr<scalar_t>();
      const std::int64_t channels = d_out.size(1), count = rows.size(1);
      for_entries<scalar_t>(rows, weights, [&](std::int64_t entry, std::int64_t row, scalar_t weight) {
        for (std::int64_t c = 0; c < channels; ++c)
          d_feature[row * channels + c] += weight * d_sum[entry / count * channels + c];
      });
    });
    return {out, Tensor(), Tensor()};
  }

 private:
  template <typename T, typename Body>
  static void for_entries(const Tensor& rows, const Tensor& weights, const Body& body) {
    const std::int64_t* row = rows.data_ptr<std::int64_t>();
    const T* weight = weights.data_ptr<T>();
    for (std::int64_t entry = 0; entry < rows.numel(); ++entry) body(entry, row[entry], weight[entry]);
  }
};

Tensor interpolated_skin(const ExtractedMesh& mesh, const Tensor& points, const MeshFieldOptions& options) {
  const Tensor features = mesh.field.attributes.narrow(1, 0, options.skin_channels);
  const bool trilinear = options.skin_interp_trilinear || options.skin_nodeform_trilinear;
  if (trilinear && deform_disabled(options)) return interpolate_trilinearly(mesh.field, features, points);
  return interpolate_from_nearest(mesh.field, features, points, options.skin_interp_nearest ? 1 : kNearVertices,
                                  options.skin_interp_use_deformed_grid);
}

void set_surface(const ExtractedSurface& surface, const MeshFieldOptions& options, SkinFeatures skin_features,
                 ExtractedMesh& mesh) {
  mesh.vertices = surface.vertices;
  mesh.faces = surface.faces;
  mesh.success = mesh.vertices.size(0) > 0 && mesh.faces.size(0) > 0;
  const std::int64_t skin = options.skin_channels;
  const std::vector<Tensor> parts = surface.attributes.split_with_sizes({skin, surface.attributes.size(1) - skin}, 1);
  if (options.use_color) mesh.attributes = parts[1];
  if (skin == 0) return;
  const bool interpolate = options.skin_interp_sparse || options.skin_nodeform_trilinear;
  if (!interpolate || mesh.vertices.size(0) == 0) {
    mesh.skin_features = parts[0];
  } else if (skin_features == SkinFeatures::kOfAllVertices) {
    mesh.skin_features = interpolated_skin(mesh, mesh.vertices, options);
  }
}

void regularize(const PredictedField& predicted, const Tensor& deviation, ExtractedMesh& mesh) {
  mesh.terms = {predicted.consistency, deviation.numel() > 0 ? deviation.mean() : deviation.sum(),
                predicted.weights_length};
  mesh.regularizer =
      mesh.terms.consistency + kDeviationFactor * mesh.terms.deviation + kWeightsFactor * mesh.terms.weights;
}

using torch::Tensor;

constexpr std::int64_t kSsimWindow = 11;
constexpr double kSsimDeviation = 1.5;
constexpr double kSsimC1 = 0.01 * 0.01, kSsimC2 = 0.03 * 0.03;
constexpr double kLeastNorm = 1e-9;

void require_like_pictures(const Tensor& a, const Tensor& b) {
  if (a.dim() == 4 && a.sizes() == b.sizes() && a.numel() > 0) return;
  throw InputError(
      "", "",
      "pictures to compare must be [N, C, H, W] and alike, found " + nn::shape_text(a) + " and " + nn::shape_text(b));
}

// One axis of the window, [11].
Tensor ssim_kernel() {
  const Tensor x = torch::arange(kSsimWindow, torch::kFloat64) - static_cast<double>(kSsimWindow / 2);
  const Tensor g = torch::exp(x.square() * (-0.5 / (kSsimDeviation * kSsimDeviation)));
  return g / g.sum();
}

// sums = Σ_t taps[t] row(t), rows of n numbers.
template <typename Row>
ANIGEN_KERNEL_INLINE void weighted_rows_sum(const float* __restrict taps, std::int64_t first, std::int64_t end,
                                            const Row& row, std::int64_t n, float* __restrict sums) {
  for (std::int64_t x = 0; x < n; ++x) sums[x] = 0.0F;
  for (std::int64_t t = first; t < end; ++t) {
    const float* const __restrict values = row(t);
    for (std::int64_t x = 0; x < n; ++x) sums[x] += taps[t] * values[x];
  }
}

// A plane by the window down and across, zeros around it. @param line [width + kSsimWindow − 1], zeros to begin with
ANIGEN_KERNEL(void, smooth_plane,
              (const float* plane, std::int64_t height, std::int64_t width, const float* taps, float* line, float* out),
              (plane, height, width, taps, line, out)) {
  constexpr std::int64_t kReach = kSsimWindow / 2;
  for (std::int64_t y = 0; y < height; ++y) {
    const std::int64_t first = std::max<std::int64_t>(0, kReach - y);
    const std::int64_t end = std::min(kSsimWindow, height + kReach - y);
    const auto below = [&](std::int64_t t) { return plane + (y + t - kReach) * width; };
    weighted_rows_sum(taps, first, end, below, width, line + kReach);
    const auto beside = [&](std::int64_t t) { return line + t; };
    weighted_rows_sum(taps, 0, kSsimWindow, beside, width, out + y * width);
  }
}

// @param planes [M, 1, H, W] @param kernel [11]
Tensor smoothed(const Tensor& planes, const Tensor& kernel) {
  if (!planes.is_cpu() || nn::dtype_of(planes) != torch::kFloat32) {
    const std::vector<std::int64_t> one{1, 1}, down{kSsimWindow / 2, 0}, across{0, kSsimWindow / 2};
    const Tensor columns = at::conv2d(planes, kernel.view({1, 1, kSsimWindow, 1}), Tensor(), one, down);
    return at::conv2d(columns, kernel.view({1, 1, 1, kSsimWindow}), Tensor(), one, across);
  }
  const Tensor given = planes.contiguous(), out = torch::empty_like(given), taps = kernel.contiguous();
  const std::int64_t height = given.size(2), width = given.size(3);
  at::parallel_for(0, given.size(0), 1, [&](std::int64_t begin, std::int64_t end) {
    std::vector<float> line(static_cast<std::size_t>(width + kSsimWindow - 1), 0.0F);
    for (std::int64_t plane = begin; plane < end; ++plane) {
      const std::int64_t first = plane * height * width;
      smooth_plane(given.data_ptr<float>() + first, height, width, taps.data_ptr<float>(), line.data(),
                   out.data_ptr<float>() + first);
    }
  });
  return out;
}

// The window is a product of two, so that two passes of 11 do what one of 121 does, and symmetric, so that the gradient
// is smoothed likewise: the library's backward pass of a convolution takes ten times as long.
class Smoothing : public torch::autograd::Function<Smoothing> {
 public:
  static Tensor forward(torch::autograd::AutogradContext* context, const Tensor& planes, const Tensor& kernel) {
    RECORD_USER_SCOPE("elementwise and copies: smoothing");
    context->save_for_backward({kernel});
    return smoothed(planes, kernel);
  }
  static torch::autograd::variable_list backward(torch::autograd::AutogradContext* context,
                                                 torch::autograd::variable_list gradients) {
    return {Smoothing::apply(gradients[0], context->get_saved_variables()[0]), Tensor()};
  }
};

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

Tensor interpolate_from_nearest(const CubeField& field, const Tensor& features, const Tensor& points,
                                std::int64_t count, bool deformed) {
  require_points(field, features, points);
  const NearestGridVertices nearest = nearest_grid_vertices(field, points, count, deformed);
  const double deviation = kGaussianCells / static_cast<double>(field.resolution);
  const Tensor gaussian = torch::exp(nearest.squared / (-2.0 * deviation * deviation));
  const Tensor weights = gaussian / gaussian.sum(1, /*keepdim=*/true).clamp_min(kLeastGaussianSum);
  const Tensor rows = nearest.rows.to(features.device()),
               shares = weights.to(features.device(), features.scalar_type()).contiguous();
  if (features.is_cpu()) return WeightedRows::apply(features, rows, shares);
  const Tensor chosen = features.index_select(0, rows.view({-1}));
  return (chosen.view({-1, count, features.size(1)}) * shares.unsqueeze(-1)).sum(1);
}

Tensor interpolate_trilinearly(const CubeField& field, const Tensor& features, const Tensor& points) {
  require_points(field, features, points);
  const auto cells = static_cast<double>(field.resolution);
  const Tensor place = ((points + 0.5) * cells).clamp(0.0, cells - 1e-6);
  const Tensor lowest = place.detach().floor().clamp_max(cells - 1.0);  // fp32 may round the bound up to R
  const Tensor high = place - lowest, low = 1.0 - high;
  const Tensor padded = torch::cat({features, torch::zeros({1, features.size(1)}, features.options())});
  Tensor sum = torch::zeros({points.size(0), features.size(1)}, features.options());
  for (int corner = 0; corner < kCubeCorners; ++corner) {
    const Tensor offset = torch::tensor({corner & 1, corner >> 1 & 1, corner >> 2 & 1}, lowest.options());
    Tensor weight = torch::ones({points.size(0)}, points.options());
    for (int axis = 0; axis < 3; ++axis) weight = weight * ((corner >> axis & 1) != 0 ? high : low).select(1, axis);
    sum = sum + weight.unsqueeze(1) * padded.index_select(0, rows_of_places(field, lowest + offset));
  }
  return sum;
}

ExtractedMesh extract_mesh(const Tensor& coords, const Tensor& feats, const MeshFieldOptions& options, bool training,
                           SkinFeatures skin_features) {
  if (options.resolution < 1 || options.skin_channels < 0)
    throw InputError("", "", "a mesh field needs a resolution of at least 1 and no negative number of skin channels");
  if (!feats.defined() || feats.dim() != 2 || feats.size(1) != options.channels()) {
    throw InputError("", "feats",
                     "expected [C, " + std::to_string(options.channels()) + "], found " + nn::shape_text(feats));
  }
  if (feats.scalar_type() != torch::kFloat32 && feats.scalar_type() != torch::kFloat64)
    throw InputError("", "feats", "expected fp32 or fp64");
  RECORD_USER_SCOPE("surface extraction: the rest");
  ExtractedMesh mesh;
  // The corners' agreement counts what was predicted, used or not.
  const PredictedField predicted = field_of(coords, feats, options);
  mesh.field = predicted.field;
  if (deform_disabled(options)) mesh.field.deform = torch::zeros_like(mesh.field.deform);
  const ExtractedSurface surface = flexicubes(mesh.field, training);
  set_surface(surface, options, skin_features, mesh);
  if (training) regularize(predicted, surface.deviation, mesh);
  return mesh;
}

Tensor skin_features_at(const ExtractedMesh& mesh, const MeshFieldOptions& options, const Tensor& vertices) {
  const auto chosen = [&](const Tensor& rows) { return vertices.defined() ? rows.index_select(0, vertices) : rows; };
  if (mesh.skin_features.defined() || options.skin_channels == 0)
    return mesh.skin_features.defined() ? chosen(mesh.skin_features) : Tensor();
  RECORD_USER_SCOPE("surface extraction: skin features");
  return interpolated_skin(mesh, chosen(mesh.vertices), options);
}

Tensor ssim_window() {
  const Tensor kernel = ssim_kernel();
  return torch::outer(kernel, kernel).to(torch::kFloat32);
}

Tensor ssim(const Tensor& a, const Tensor& b) {
  require_like_pictures(a, b);
  const std::int64_t items = a.size(0), height = a.size(2), width = a.size(3);
  const auto planes = [&](const Tensor& x) { return x.reshape({-1, 1, height, width}); };
  const Tensor pa = planes(a), pb = planes(b);
  const Tensor kernel = ssim_kernel().to(a.options());
  const Tensor smooth = Smoothing::apply(torch::cat({pa, pb, pa * pa, pb * pb, pa * pb}), kernel);
  const std::vector<Tensor> means = smooth.chunk(5);
  const Tensor &mu_a = means[0], &mu_b = means[1];
  const Tensor mu_aa = mu_a * mu_a, mu_bb = mu_b * mu_b, mu_ab = mu_a * mu_b;
  const Tensor var_a = means[2] - mu_aa, var_b = means[3] - mu_bb, covariance = means[4] - mu_ab;
  const Tensor map = ((2.0 * mu_ab + kSsimC1) * (2.0 * covariance + kSsimC2)) /
                     ((mu_aa + mu_bb + kSsimC1) * (var_a + var_b + kSsimC2));
  return map.reshape({items, -1}).mean(1);
}

Tensor psnr(const Tensor& a, const Tensor& b) { return -10.0 * torch::log10((a - b).square().mean()); }

Tensor normal_angle(const Tensor& a, const Tensor& b) {
  const Tensor na = 2.0 * a - 1.0, nb = 2.0 * b - 1.0;
  const Tensor norms = na.norm(2, -1) * nb.norm(2, -1);
  const Tensor usable = norms > kLeastNorm;
  if (!usable.any().item<bool>()) return (a.sum() + b.sum()) * 0.0;
  const Tensor cosine = ((na * nb).sum(-1) / (norms + kLeastNorm)).clamp(-1.0, 1.0);
  return torch::rad2deg(torch::acos(cosine.masked_select(usable))).mean();
}

PerceptualLoss perceptual_loss(const Tensor& a, const Tensor& b, const PerceptualOptions& options,
                               const PictureDistance& distance) {
  require_like_pictures(a, b);
  PerceptualLoss loss;
  loss.l1 = (a - b).abs().mean();
  loss.total = loss.l1;
  if (options.lambda_ssim != 0.0) {
    loss.ssim = 1.0 - ssim(a, b).mean();
    loss.total = loss.total + options.lambda_ssim * loss.ssim;
  }
  if (options.lambda_lpips != 0.0) {
    if (!distance) throw InputError("", "lambda_lpips", "there is no LPIPS network to compute this term with");
    loss.lpips = distance(a, b).mean();
    loss.total = loss.total + options.lambda_lpips * loss.lpips;
  }
  return loss;
}

void GeometryLossOptions::set_depth_loss(const std::string& word) {
  if (word != "l1" && word != "smooth_l1")
    throw InputError("", "depth_loss_type", "expected l1 or smooth_l1, found '" + word.substr(0, 80) + "'");
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

}  // namespace anigen::shape_field
