#include "anigen/fields/cube_field.h"

#include <string>
#include <utility>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/fields/grid_sets.h"
#include "anigen/fields/row_links.h"
#include "anigen/nn/shape_text.h"

namespace anigen::fields {
namespace {

void require_shape(const char* what, const Tensor& tensor, torch::IntArrayRef shape, const Tensor& like) {
  bool fits = tensor.defined() && tensor.dim() == static_cast<std::int64_t>(shape.size());
  for (std::size_t i = 0; fits && i < shape.size(); ++i) {
    fits = shape[i] < 0 || tensor.size(static_cast<std::int64_t>(i)) == shape[i];
  }
  if (!fits) {
    throw InputError("", what, "expected " + nn::shape_text(shape) + " (-1: any), found " + nn::shape_text(tensor));
  }
  if (tensor.scalar_type() != like.scalar_type() || tensor.device() != like.device()) {
    throw InputError("", what, "must have the type and device of the signed distances");
  }
}

void require_corners(const CubeCorners& corners, std::int64_t resolution) {
  if (resolution < 1 || resolution > kMostCubeResolution) {
    throw InputError(
        "", "resolution",
        "must be in [1, " + std::to_string(kMostCubeResolution) + "], found " + std::to_string(resolution));
  }
  const Tensor& coords = corners.coords;
  const bool places = coords.defined() && coords.dim() == 2 && coords.size(1) == 3 &&
                      (coords.scalar_type() == torch::kInt32 || coords.scalar_type() == torch::kInt64);
  if (!places) throw InputError("", "coords", "expected integers [C, 3], found " + nn::shape_text(coords));
  if (!corners.sdf.defined() ||
      (corners.sdf.scalar_type() != torch::kFloat32 && corners.sdf.scalar_type() != torch::kFloat64)) {
    throw InputError("", "sdf", "expected fp32 or fp64");
  }
  const std::int64_t cubes = coords.size(0);
  require_shape("sdf", corners.sdf, {cubes, kCubeCorners}, corners.sdf);
  require_shape("deform", corners.deform, {cubes, kCubeCorners, 3}, corners.sdf);
  require_shape("attributes", corners.attributes, {cubes, kCubeCorners, -1}, corners.sdf);
  require_shape("weights", corners.weights, {cubes, kCubeWeights}, corners.sdf);
}

// Active cubes in ascending order, and the row of each.
struct SortedCubes {
  GridSet numbers;
  std::vector<std::int32_t> rows;
};

SortedCubes sorted_cubes(const Tensor& coords, std::int64_t resolution, const GridNumbering& grid) {
  const Tensor outside = (coords.lt(0)).logical_or(coords.ge(resolution)).any(1);
  if (outside.any().item<bool>()) {
    const std::int64_t row = outside.nonzero()[0].item<std::int64_t>();
    throw InputError("", "coords row " + std::to_string(row),
                     "cube outside the grid of resolution " + std::to_string(resolution));
  }
  const std::vector<std::int64_t> numbers = grid_numbers(coords, grid);
  SortedCubes sorted{{}, sorting_order(numbers)};
  sorted.numbers.reserve(numbers.size());
  for (const std::int32_t row : sorted.rows) {
    const std::int64_t number = numbers[static_cast<std::size_t>(row)];
    if (!sorted.numbers.empty() && sorted.numbers.back() == number) {
      throw InputError("", "coords row " + std::to_string(row), "a cube that is there twice");
    }
    sorted.numbers.push_back(number);
  }
  return sorted;
}

// Which vertex each corner is: targets by cube and corner, sources with one slot per corner number.
RowLinks link_corners(const SortedCubes& cubes, const GridSet& vertices, const GridNumbering& grid) {
  const auto cube_count = static_cast<std::int64_t>(cubes.numbers.size());
  const auto vertex_count = static_cast<std::int64_t>(vertices.size());
  RowLinks links{torch::empty({cube_count * kCubeCorners}, torch::kInt64),
                 torch::full({vertex_count, kCubeCorners}, -1, torch::kInt32)};
  std::int64_t* targets = links.targets.data_ptr<std::int64_t>();
  std::int32_t* sources = links.sources.data_ptr<std::int32_t>();
  for (int corner = 0; corner < kCubeCorners; ++corner) {
    match_shifted(vertices, cubes.numbers, grid.corner_step(corner), [&](std::int64_t i, std::int64_t vertex) {
      const std::int32_t entry = cubes.rows[static_cast<std::size_t>(i)] * kCubeCorners + corner;
      targets[entry] = vertex;
      sources[vertex * kCubeCorners + corner] = entry;
    });
  }
  return links;
}

}  // namespace

Tensor vertex_positions(const Tensor& places, const Tensor& deform, std::int64_t resolution, const Tensor& like) {
  const auto size = static_cast<double>(resolution);
  const Tensor grid = places.to(like.device(), like.scalar_type()) / size - 0.5;
  if (!deform.defined()) return grid;
  return grid + torch::tanh(deform) * ((1.0 - 1e-8) / (2.0 * size));
}

Tensor CubeField::grid_positions() const { return vertex_positions(vertices, Tensor(), resolution, sdf); }

Tensor CubeField::positions() const { return vertex_positions(vertices, deform, resolution, sdf); }

CubeField average_corners(const CubeCorners& corners, std::int64_t resolution) {
  require_corners(corners, resolution);
  const GridNumbering grid{resolution + 1};
  const SortedCubes cubes = sorted_cubes(corners.coords, resolution, grid);
  TORCH_CHECK(cubes.numbers.size() < (std::size_t{1} << 28), "too many cubes");  // entries are numbered with 31 bits
  GridSet vertices = cubes.numbers;
  for (const int axis : {2, 1, 0}) vertices = with_shifted(vertices, grid.step(axis));

  const torch::Device device = corners.sdf.device();
  const RowLinks links = link_corners(cubes, vertices, grid).to(device);
  const Tensor counts = links.sources.ge(0).sum(1, /*keepdim=*/true).to(corners.sdf.scalar_type());
  const auto mean = [&](const Tensor& values) { return sum_rows(values, links) / counts; };

  CubeField field;
  field.resolution = resolution;
  field.vertices = grid_places(vertices, grid).to(device);
  field.sdf = mean(corners.sdf.unsqueeze(-1)).squeeze(-1);
  field.deform = mean(corners.deform);
  field.attributes = mean(corners.attributes);
  field.coords = corners.coords;
  field.corner_vertices = links.targets.view({-1, kCubeCorners});
  field.weights = corners.weights;
  return field;
}

}  // namespace anigen::fields
