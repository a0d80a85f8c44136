#include "anigen/fields/mesh_extraction.h"

#include <string>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/fields/skin_feature_interpolation.h"
#include "anigen/nn/shape_text.h"

namespace anigen::fields {
namespace {

constexpr std::int64_t kColorChannels = 6;    // RGB, normal map
constexpr std::int64_t kRegularWeights = 20;  // beta and alpha, not gamma
constexpr double kDeviationFactor = 0.5, kWeightsFactor = 0.2;
constexpr std::int64_t kNearVertices = 8;

bool deform_disabled(const MeshFieldOptions& options) {
  return options.disable_deform || options.skin_nodeform_trilinear;
}

// The layout of reference autoencoders.md, 3.8. Attributes are the skin feature, then the colours.
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

Tensor interpolated_skin(const ExtractedMesh& mesh, const MeshFieldOptions& options) {
  const Tensor features = mesh.field.attributes.narrow(1, 0, options.skin_channels);
  const bool trilinear = options.skin_interp_trilinear || options.skin_nodeform_trilinear;
  if (trilinear && deform_disabled(options)) return interpolate_trilinearly(mesh.field, features, mesh.vertices);
  return interpolate_from_nearest(mesh.field, features, mesh.vertices, options.skin_interp_nearest ? 1 : kNearVertices,
                                  options.skin_interp_use_deformed_grid);
}

void set_surface(const ExtractedSurface& surface, const MeshFieldOptions& options, ExtractedMesh& mesh) {
  mesh.vertices = surface.vertices;
  mesh.faces = surface.faces;
  mesh.success = mesh.vertices.size(0) > 0 && mesh.faces.size(0) > 0;
  const std::int64_t skin = options.skin_channels;
  const std::vector<Tensor> parts = surface.attributes.split_with_sizes({skin, surface.attributes.size(1) - skin}, 1);
  if (options.use_color) mesh.attributes = parts[1];
  if (skin == 0) return;
  const bool interpolate = options.skin_interp_sparse || options.skin_nodeform_trilinear;
  mesh.skin_features = interpolate && mesh.vertices.size(0) > 0 ? interpolated_skin(mesh, options) : parts[0];
}

void regularize(const CubeCorners& corners, const Tensor& consistency, const Tensor& deviation, ExtractedMesh& mesh) {
  const Tensor weights = corners.weights.narrow(1, 0, kRegularWeights);
  const auto mean = [](const Tensor& x) { return x.numel() > 0 ? x.mean() : x.sum(); };
  mesh.terms = {consistency, mean(deviation), mean(weights.abs())};
  mesh.regularizer =
      mesh.terms.consistency + kDeviationFactor * mesh.terms.deviation + kWeightsFactor * mesh.terms.weights;
}

}  // namespace

ExtractedMesh extract_mesh(const Tensor& coords, const Tensor& feats, const MeshFieldOptions& options, bool training) {
  if (options.resolution < 1 || options.skin_channels < 0) {
    throw InputError("", "", "a mesh field needs a resolution of at least 1 and no negative number of skin channels");
  }
  if (!feats.defined() || feats.dim() != 2 || feats.size(1) != options.channels()) {
    throw InputError("", "feats",
                     "expected [C, " + std::to_string(options.channels()) + "], found " + nn::shape_text(feats));
  }
  if (feats.scalar_type() != torch::kFloat32 && feats.scalar_type() != torch::kFloat64) {
    throw InputError("", "feats", "expected fp32 or fp64");
  }
  RECORD_USER_SCOPE("surface extraction: the rest");
  const CubeCorners corners = split_channels(coords, feats, options);
  ExtractedMesh mesh;
  mesh.field = average_corners(corners, options.resolution);
  // The corners' agreement counts what was predicted, used or not.
  const Tensor consistency = training ? corner_consistency(corners, mesh.field) : Tensor();
  if (deform_disabled(options)) mesh.field.deform = torch::zeros_like(mesh.field.deform);
  const ExtractedSurface surface = flexicubes(mesh.field, training);
  set_surface(surface, options, mesh);
  if (training) regularize(corners, consistency, surface.deviation, mesh);
  return mesh;
}

}  // namespace anigen::fields
