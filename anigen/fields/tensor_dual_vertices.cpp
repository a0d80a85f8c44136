#include <array>

#include "anigen/fields/dual_vertices.h"
#include "anigen/fields/flexicubes_tables.h"
#include "anigen/fields/grid_sets.h"

namespace anigen::fields {
namespace {

// One row per (dual vertex, edge), in the order of cubes, groups and edges; columns as named.
enum CrossingColumn : std::int64_t { kVertexA, kVertexB, kAlphaA, kAlphaB, kBetaOf, kDual, kCrossingColumns };

// @return [K, kCrossingColumns] int64
Tensor crossing_list(const DualTopology& topology) {
  const FlexicubesTables& tables = flexicubes_tables();
  const Tensor list = torch::empty({topology.crossings, std::int64_t{kCrossingColumns}}, torch::kInt64);
  std::int64_t* row = list.data_ptr<std::int64_t>();
  const std::int32_t* corners = topology.corners.data_ptr<std::int32_t>();
  const std::int32_t* first_dual = topology.first_dual.data_ptr<std::int32_t>();
  const std::uint8_t* cases = topology.cases.data_ptr<std::uint8_t>();
  for (std::int64_t cube = 0; cube < topology.cubes(); ++cube) {
    const auto groups = static_cast<std::size_t>(tables.counts[cases[cube]]);
    for (std::size_t group = 0; group < groups; ++group) {
      for (const std::int16_t edge : tables.groups[cases[cube]][group]) {
        if (edge < 0) break;
        const auto& [a, b] = kEdgeCorners[static_cast<std::size_t>(edge)];
        row[kAlphaA] = cube * kCubeCorners + a;
        row[kAlphaB] = cube * kCubeCorners + b;
        row[kVertexA] = corners[row[kAlphaA]];
        row[kVertexB] = corners[row[kAlphaB]];
        row[kBetaOf] = cube * kCubeEdges + edge;
        row[kDual] = first_dual[cube] + static_cast<std::int64_t>(group);
        row += kCrossingColumns;
      }
    }
  }
  return list;
}

// The point where a linear function with values w_a, w_b at a, b is zero.
Tensor linear_zero(const Tensor& a, const Tensor& b, const Tensor& w_a, const Tensor& w_b) {
  return (a * w_b - b * w_a) / (w_b - w_a);
}

}  // namespace

DualVertices tensor_dual_vertices(const Tensor& rows, const Tensor& alpha, const Tensor& beta,
                                  const DualTopology& topology, bool with_deviation) {
  const Tensor list = crossing_list(topology).to(rows.device());
  const auto column = [&](CrossingColumn which) { return list.select(1, which).contiguous(); };
  const auto chosen = [](const Tensor& values, const Tensor& index) {
    return values.reshape({-1}).index_select(0, index).unsqueeze(1);
  };
  const Tensor dual = column(kDual);
  const auto sum = [&](const Tensor& values) {
    return torch::zeros({topology.duals, values.size(1)}, rows.options()).index_add(0, dual, values);
  };
  const Tensor a = rows.index_select(0, column(kVertexA)), b = rows.index_select(0, column(kVertexB));
  const Tensor s_a = a.narrow(1, 0, 1), s_b = b.narrow(1, 0, 1);
  const Tensor x_a = a.narrow(1, 1, rows.size(1) - 1), x_b = b.narrow(1, 1, rows.size(1) - 1);
  const Tensor w_a = s_a * chosen(alpha, column(kAlphaA)), w_b = s_b * chosen(alpha, column(kAlphaB));
  const Tensor weight = chosen(beta, column(kBetaOf));

  DualVertices found;
  found.values = sum(weight * linear_zero(x_a, x_b, w_a, w_b)) / sum(weight);
  if (!with_deviation) return found;
  const Tensor zero = linear_zero(x_a.narrow(1, 0, 3), x_b.narrow(1, 0, 3), s_a, s_b);
  const Tensor distance = (zero - found.values.narrow(1, 0, 3).index_select(0, dual)).norm(2, 1, /*keepdim=*/true);
  const Tensor mean = sum(distance) / sum(torch::ones_like(distance));
  found.deviation = (distance - mean.index_select(0, dual)).abs().squeeze(1);
  return found;
}

}  // namespace anigen::fields
