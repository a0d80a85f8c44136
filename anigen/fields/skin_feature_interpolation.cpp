#include "anigen/fields/skin_feature_interpolation.h"

#include <vector>

#include "anigen/fields/grid_sets.h"
#include "anigen/fields/nearest_grid_vertices.h"

namespace anigen::fields {
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

}  // namespace

Tensor interpolate_from_nearest(const CubeField& field, const Tensor& features, const Tensor& points,
                                std::int64_t count, bool deformed) {
  require_points(field, features, points);
  const NearestGridVertices nearest = nearest_grid_vertices(field, points, count, deformed);
  const double deviation = kGaussianCells / static_cast<double>(field.resolution);
  const Tensor gaussian = torch::exp(nearest.squared / (-2.0 * deviation * deviation));
  const Tensor weights = gaussian / gaussian.sum(1, /*keepdim=*/true).clamp_min(kLeastGaussianSum);
  const Tensor chosen = features.index_select(0, nearest.rows.view({-1}).to(features.device()));
  return (chosen.view({-1, count, features.size(1)}) *
          weights.to(features.device(), features.scalar_type()).unsqueeze(-1))
      .sum(1);
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

}  // namespace anigen::fields
