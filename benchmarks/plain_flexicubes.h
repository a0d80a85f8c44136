#pragma once
#include <array>
#include <cstdint>
#include <tuple>
#include <vector>

#include "anigen/shape_field/flexicubes.h"

namespace anigen::benchmarks {

using torch::Tensor;

/// FlexiCubes as one writes it with tensor operations on the whole grid, (R + 1)³ vertices and R³ cubes: what
/// shape_field::flexicubes is timed against, and checked against on small grids.
class PlainFlexicubes {
 public:
  /// Spreads a sparse field over the grid: sdf +1, everything else 0, where it has nothing.
  explicit PlainFlexicubes(const shape_field::CubeField& field)
      : resolution_(field.resolution), side_(resolution_ + 1) {
    const auto options = field.sdf.options();
    const Tensor vertices = numbers(field.vertices.to(torch::kInt64), side_);
    const Tensor cubes = numbers(field.coords.to(torch::kInt64), resolution_);
    const std::int64_t vertex_count = side_ * side_ * side_;
    const auto spread = [&](const Tensor& values, const Tensor& rows, std::int64_t count) {
      return torch::zeros({count, values.size(1)}, options).index_copy(0, rows, values);
    };
    sdf_ = torch::ones({vertex_count}, options).index_copy(0, vertices, field.sdf);
    attributes_ = spread(field.attributes, vertices, vertex_count);
    weights_ = spread(field.weights, cubes, resolution_ * resolution_ * resolution_);
    const Tensor all = torch::arange(vertex_count, torch::kInt64);
    positions_ = places(all, side_).to(options.device(), field.sdf.scalar_type()) / static_cast<double>(resolution_) -
                 0.5 +
                 (1.0 - 1e-8) / (2.0 * static_cast<double>(resolution_)) *
                     torch::tanh(spread(field.deform, vertices, vertex_count));
  }

  shape_field::ExtractedSurface extract(bool training) {
    shape_field::ExtractedSurface surface;
    find_surface_cubes();
    find_crossings();
    const Tensor raw = weights_.index_select(0, surface_);
    const Tensor beta = torch::tanh(raw.slice(1, 0, 12)) * 0.99 + 1.0;
    const Tensor alpha = torch::tanh(raw.slice(1, 12, 20)) * 0.99 + 1.0;
    const Tensor gamma = torch::sigmoid(raw.select(1, 20)) * 0.99 + 0.005;
    surface.vertices = duals(positions_, alpha, beta);
    surface.attributes = duals(attributes_, alpha, beta);
    if (training) surface.deviation = deviation(surface.vertices);
    find_quads();
    const Tensor corner_gamma = gamma.index_select(0, quad_cubes_.view({-1})).view({-1, 4});
    const Tensor first = corner_gamma.select(1, 0) * corner_gamma.select(1, 2);
    const Tensor second = corner_gamma.select(1, 1) * corner_gamma.select(1, 3);
    if (!training) {
      const Tensor along_first = columns(quads_, {0, 1, 2, 0, 2, 3}),
                   along_second = columns(quads_, {0, 1, 3, 3, 1, 2});
      surface.faces = torch::where(first.gt(second).unsqueeze(1), along_first, along_second).reshape({-1, 3});
      return surface;
    }
    const std::int64_t dual_count = surface.vertices.size(0);
    const Tensor index = (torch::arange(quads_.size(0), torch::kInt64) + dual_count).unsqueeze(1);
    surface.faces = columns(torch::cat({quads_, index}, 1), {0, 1, 4, 1, 2, 4, 2, 3, 4, 3, 0, 4}).reshape({-1, 3});
    surface.vertices = with_centres(surface.vertices, first.unsqueeze(1), second.unsqueeze(1));
    surface.attributes = with_centres(surface.attributes, first.unsqueeze(1), second.unsqueeze(1));
    return surface;
  }

 private:
  static Tensor numbers(const Tensor& places, std::int64_t side) {
    return (places.select(1, 0) * side + places.select(1, 1)) * side + places.select(1, 2);
  }
  static Tensor places(const Tensor& numbers, std::int64_t side) {
    const Tensor rows = torch::div(numbers, side, "floor");
    return torch::stack({torch::div(rows, side, "floor"), rows.remainder(side), numbers.remainder(side)}, 1);
  }
  static Tensor list(const std::vector<std::int64_t>& values) { return torch::tensor(values, torch::kInt64); }
  static Tensor columns(const Tensor& table, const std::vector<std::int64_t>& which) {
    return table.index_select(1, list(which));
  }
  static Tensor where_true(const Tensor& mask) { return mask.nonzero().squeeze(1); }

  template <typename Table>
  static Tensor flat_table(const Table& table) {
    std::vector<std::int64_t> values;
    append(table, values);
    return list(values);
  }
  static void append(std::int16_t value, std::vector<std::int64_t>& out) { out.push_back(value); }
  static void append(int value, std::vector<std::int64_t>& out) { out.push_back(value); }
  template <typename T, std::size_t N>
  static void append(const std::array<T, N>& table, std::vector<std::int64_t>& out) {
    for (const auto& item : table) append(item, out);
  }

  void find_surface_cubes() {
    const std::int64_t r = resolution_;
    const Tensor steps = torch::arange(r, torch::kInt64);
    const Tensor lowest =
        ((steps.view({-1, 1, 1}) * side_ + steps.view({1, -1, 1})) * side_ + steps.view({1, 1, -1})).reshape({-1, 1});
    const std::int64_t x = side_ * side_, y = side_;
    const Tensor corners = lowest + list({0, x, y, x + y, 1, x + 1, y + 1, x + y + 1});
    inside_ = sdf_.detach().lt(0);
    const Tensor inside = inside_.index_select(0, corners.view({-1})).view({-1, 8});
    const Tensor count = inside.sum(1);
    surface_ = where_true(count.gt(0).logical_and(count.lt(8)));
    corners_ = corners.index_select(0, surface_);
    cases_ = (inside.index_select(0, surface_).to(torch::kInt64) * list({1, 2, 4, 8, 16, 32, 64, 128})).sum(1);

    const Tensor row = flat_table(shape_field::flexicubes_tables().ambiguity).view({256, 5}).index_select(0, cases_);
    const Tensor flagged = row.select(1, 0).eq(1);
    const Tensor grid_flags =
        torch::zeros({r * r * r}, torch::kUInt8).index_copy(0, surface_, flagged.to(torch::kUInt8));
    const Tensor across = places(surface_, r) + row.slice(1, 1, 4);
    const Tensor in_grid = across.ge(0).logical_and(across.lt(r)).all(1);
    const Tensor both = grid_flags.index_select(0, numbers(across.clamp(0, r - 1), r)).eq(1).logical_and(flagged);
    cases_ = torch::where(both.logical_and(in_grid), row.select(1, 4), cases_);
  }

  // One entry per dual vertex and edge, dual vertices by number of groups of their cube, then cube, then group.
  void find_crossings() {
    const Tensor groups = flat_table(shape_field::flexicubes_tables().groups).view({256, 4, 7});
    const Tensor count = flat_table(shape_field::flexicubes_tables().counts).index_select(0, cases_);
    std::vector<Tensor> cube, edge, dual;
    dual_count_ = 0;
    for (std::int64_t n = 1; n <= 4; ++n) {
      const Tensor cubes = where_true(count.eq(n));
      const Tensor edges = groups.index_select(0, cases_.index_select(0, cubes)).slice(1, 0, n).reshape({-1, 7});
      const Tensor used = edges.ge(0).nonzero();  // row, place in the group
      cube.push_back(cubes.index_select(0, torch::div(used.select(1, 0), n, "floor")));
      edge.push_back(edges.masked_select(edges.ge(0)));
      dual.push_back(used.select(1, 0) + dual_count_);
      dual_count_ += edges.size(0);
    }
    cube_ = torch::cat(cube);
    edge_ = torch::cat(edge);
    dual_ = torch::cat(dual);
    const Tensor ends = flat_table(shape_field::kEdgeCorners).view({12, 2}).index_select(0, edge_);
    end_a_ = cube_ * 8 + ends.select(1, 0);
    end_b_ = cube_ * 8 + ends.select(1, 1);
    vertex_a_ = corners_.view({-1}).index_select(0, end_a_);
    vertex_b_ = corners_.view({-1}).index_select(0, end_b_);
  }

  Tensor sum_by_dual(const Tensor& values) const {
    return torch::zeros({dual_count_, values.size(1)}, values.options()).index_add(0, dual_, values);
  }

  Tensor duals(const Tensor& values, const Tensor& alpha, const Tensor& beta) const {
    const auto weighted = [&](const Tensor& vertex, const Tensor& end) {
      return (sdf_.index_select(0, vertex) * alpha.reshape({-1}).index_select(0, end)).unsqueeze(1);
    };
    const Tensor w_a = weighted(vertex_a_, end_a_), w_b = weighted(vertex_b_, end_b_);
    const Tensor point =
        (values.index_select(0, vertex_a_) * w_b - values.index_select(0, vertex_b_) * w_a) / (w_b - w_a);
    const Tensor weight = beta.reshape({-1}).index_select(0, cube_ * 12 + edge_).unsqueeze(1);
    return sum_by_dual(weight * point) / sum_by_dual(weight);
  }

  Tensor deviation(const Tensor& vertices) const {
    const Tensor s_a = sdf_.index_select(0, vertex_a_).unsqueeze(1), s_b = sdf_.index_select(0, vertex_b_).unsqueeze(1);
    const Tensor zero =
        (positions_.index_select(0, vertex_a_) * s_b - positions_.index_select(0, vertex_b_) * s_a) / (s_b - s_a);
    const Tensor distance = (zero - vertices.index_select(0, dual_)).norm(2, 1, /*keepdim=*/true);
    const Tensor mean = sum_by_dual(distance) / sum_by_dual(torch::ones_like(distance));
    return (distance - mean.index_select(0, dual_)).abs().squeeze(1);
  }

  void find_quads() {
    const Tensor dual_of =
        torch::full({surface_.size(0) * 12}, -1, torch::kInt64).index_copy(0, cube_ * 12 + edge_, dual_);
    const Tensor ends = flat_table(shape_field::kEdgeCorners).view({12, 2});
    const Tensor first = corners_.index_select(1, ends.select(1, 0)).reshape({-1});
    const Tensor second = corners_.index_select(1, ends.select(1, 1)).reshape({-1});
    const Tensor crossing = where_true(inside_.index_select(0, first).ne(inside_.index_select(0, second)));
    const Tensor key = (first * (side_ * side_ * side_) + second).index_select(0, crossing);
    const auto unique = at::_unique2(key, /*sorted=*/true, /*return_inverse=*/true, /*return_counts=*/true);
    const Tensor &inverse = std::get<1>(unique), &counts = std::get<2>(unique);
    const Tensor kept = where_true(counts.index_select(0, inverse).eq(4));
    const Tensor entries = crossing.index_select(0, kept);  // 12 cube + edge
    const Tensor order = (inverse.index_select(0, kept) * (12 * surface_.size(0)) + entries).argsort();
    const Tensor around = entries.index_select(0, order).view({-1, 4});
    const Tensor outward = sdf_.detach().gt(0).index_select(0, first.index_select(0, around.select(1, 0)));
    const Tensor corner =
        torch::cat({columns(around.index_select(0, where_true(outward)), {0, 1, 3, 2}),
                    columns(around.index_select(0, where_true(outward.logical_not())), {2, 3, 1, 0})});
    quads_ = dual_of.index_select(0, corner.view({-1})).view({-1, 4});
    quad_cubes_ = torch::div(corner, 12, "floor");
  }

  Tensor with_centres(const Tensor& values, const Tensor& first, const Tensor& second) const {
    const Tensor corner = values.index_select(0, quads_.view({-1})).view({-1, 4, values.size(1)});
    const Tensor along_first = (corner.select(1, 0) + corner.select(1, 2)) / 2.0;
    const Tensor along_second = (corner.select(1, 1) + corner.select(1, 3)) / 2.0;
    return torch::cat({values, (along_first * first + along_second * second) / (first + second + 1e-8)});
  }

  std::int64_t resolution_, side_, dual_count_ = 0;
  Tensor sdf_, positions_, attributes_, weights_;                    // of the whole grid
  Tensor inside_, surface_, corners_, cases_;                        // surface cubes
  Tensor cube_, edge_, dual_, end_a_, end_b_, vertex_a_, vertex_b_;  // crossings
  Tensor quads_, quad_cubes_;
};

}  // namespace anigen::benchmarks
