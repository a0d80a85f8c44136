#include "anigen/fields/flexicubes.h"

#include <vector>

#include "anigen/fields/dual_vertices.h"
#include "anigen/fields/flexicubes_topology.h"
#include "anigen/fields/grid_sets.h"

namespace anigen::fields {
namespace {

constexpr double kWeightRange = 0.99;  // weights lie in 1 ± 0.99, gamma in [0.005, 0.995]

ExtractedSurface empty_surface(const CubeField& field, bool training) {
  ExtractedSurface surface;
  surface.vertices = torch::zeros({0, 3}, field.sdf.options());
  surface.faces = torch::zeros({0, 3}, field.sdf.options().dtype(torch::kInt64));
  surface.attributes = torch::zeros({0, field.attributes.size(1)}, field.sdf.options());
  if (training) surface.deviation = torch::zeros({0}, field.sdf.options());
  return surface;
}

// Signed distance, position and attributes at the grid vertices of surface cubes. @return [S, 4 + A]
Tensor vertex_rows(const CubeField& field, const DualTopology& topology) {
  const RowLinks links = topology.vertices.to(field.sdf.device());
  const Tensor outside = links.targets.lt(0).to(field.sdf.scalar_type()).unsqueeze(1);  // +1 where no cube is active
  const Tensor sdf = gather_rows(field.sdf.unsqueeze(1), links) + outside;
  const Tensor deform = gather_rows(field.deform, links);
  return torch::cat({sdf, vertex_positions(topology.vertex_places, deform, field.resolution, field.sdf),
                     gather_rows(field.attributes, links)},
                    1);
}

struct SurfaceWeights {
  Tensor beta, alpha, gamma;  // [Q, 12], [Q, 8], [Q, 1]
};

SurfaceWeights surface_weights(const CubeField& field, const DualTopology& topology) {
  const Tensor raw = gather_rows(field.weights, topology.weights.to(field.sdf.device()));
  const std::vector<Tensor> parts = raw.split_with_sizes({12, 8, 1}, 1);
  const auto around_one = [](const Tensor& part) { return torch::tanh(part) * kWeightRange + 1.0; };
  return {around_one(parts[0]), around_one(parts[1]), torch::sigmoid(parts[2]) * kWeightRange + 0.005};
}

// Products of gamma over the diagonals 0–2 and 1–3 of each quad. @return [F, 1] each
struct DiagonalWeights {
  DiagonalWeights(const Tensor& gamma, const RowLinks& quad_cubes) {
    const std::vector<Tensor> corner = gather_rows(gamma, quad_cubes).view({-1, 4}).split(1, 1);
    first = corner[0] * corner[2];
    second = corner[1] * corner[3];
  }
  Tensor first, second;
};

// Columns of the quads as triangles. @param quads [F, 4 or 5] @return [F · columns / 3, 3]
Tensor triangles(const Tensor& quads, const std::vector<std::int64_t>& columns) {
  const Tensor index = torch::tensor(columns, quads.options());
  return quads.index_select(1, index).view({-1, 3});
}

// Two triangles along the diagonal with the larger product.
Tensor split_quads(const Tensor& quads, const DiagonalWeights& weights) {
  const auto as_rows = [](const Tensor& faces) { return faces.view({-1, 6}); };
  const Tensor along_first = as_rows(triangles(quads, {0, 1, 2, 0, 2, 3}));
  const Tensor along_second = as_rows(triangles(quads, {0, 1, 3, 3, 1, 2}));
  return torch::where(weights.first.gt(weights.second), along_first, along_second).reshape({-1, 3});
}

// A vertex in the middle of each quad, between the middles of its diagonals. @param values [D, ch] @return [F, ch]
Tensor quad_centres(const Tensor& values, const RowLinks& quad_duals, const DiagonalWeights& weights) {
  const std::vector<Tensor> corner = gather_rows(values, quad_duals).view({-1, 4, values.size(1)}).unbind(1);
  const Tensor first = (corner[0] + corner[2]) / 2.0, second = (corner[1] + corner[3]) / 2.0;
  return (first * weights.first + second * weights.second) / (weights.first + weights.second + 1e-8);
}

}  // namespace

ExtractedSurface flexicubes(const CubeField& field, bool training) {
  const DualTopology topology = dual_topology(field);
  if (topology.cubes() == 0) return empty_surface(field, training);
  const torch::Device device = field.sdf.device();
  const SurfaceWeights weights = surface_weights(field, topology);
  const DualVertices duals =
      dual_vertices(vertex_rows(field, topology), weights.alpha, weights.beta, topology, training);

  const RowLinks quad_duals = topology.quad_duals.to(device), quad_cubes = topology.quad_cubes.to(device);
  const Tensor quads = quad_duals.targets.view({-1, 4});
  const DiagonalWeights diagonals(training ? weights.gamma : weights.gamma.detach(), quad_cubes);
  Tensor values = duals.values;
  ExtractedSurface surface;
  if (training) {
    const Tensor centres = quad_centres(values, quad_duals, diagonals);
    const Tensor index = torch::arange(quads.size(0), quads.options()).unsqueeze(1) + topology.duals;
    surface.faces = triangles(torch::cat({quads, index}, 1), {0, 1, 4, 1, 2, 4, 2, 3, 4, 3, 0, 4});
    values = torch::cat({values, centres});
    surface.deviation = duals.deviation;
  } else {
    surface.faces = split_quads(quads, diagonals);
  }
  const std::vector<Tensor> parts = values.split_with_sizes({3, values.size(1) - 3}, 1);
  surface.vertices = parts[0].contiguous();
  surface.attributes = parts[1].contiguous();
  return surface;
}

}  // namespace anigen::fields
