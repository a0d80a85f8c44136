#include "anigen/shape_field/dual_vertices.h"

#include <array>

#include "anigen/shape_field/dual_vertex_kernels.h"
#include "anigen/shape_field/grid.h"

namespace anigen::shape_field {

namespace {

using torch::autograd::AutogradContext;
using torch::autograd::variable_list;

// Topology as the kernels need it, as tensors that a backward pass can keep.
enum SavedTensor : std::size_t { kRows, kAlpha, kBeta, kCorners, kCornerSources, kCases, kFirstDual, kFirstCrossing };

template <typename T>
kernels::DualCubes<T> dual_cubes(const variable_list& saved) {
  kernels::DualCubes<T> problem;
  problem.cubes = saved[kCases].size(0);
  problem.channels = saved[kRows].size(1) - 1;
  problem.rows = saved[kRows].data_ptr<T>();
  problem.alpha = saved[kAlpha].data_ptr<T>();
  problem.beta = saved[kBeta].data_ptr<T>();
  problem.corners = saved[kCorners].data_ptr<std::int32_t>();
  problem.cases = saved[kCases].data_ptr<std::uint8_t>();
  problem.first_dual = saved[kFirstDual].data_ptr<std::int32_t>();
  problem.first_crossing = saved[kFirstCrossing].data_ptr<std::int32_t>();
  return problem;
}

template <typename T>
void run_forward(const variable_list& saved, const Tensor& values, const Tensor& deviation) {
  kernels::dual_vertices_forward<T>(dual_cubes<T>(saved), values.data_ptr<T>(),
                                    deviation.defined() ? deviation.data_ptr<T>() : nullptr);
}

template <typename T>
void run_backward(const variable_list& saved, const Tensor& d_values, const Tensor& d_deviation,
                  const Tensor& d_corners, const Tensor& d_alpha, const Tensor& d_beta) {
  kernels::dual_vertices_backward<T>(dual_cubes<T>(saved), d_values.data_ptr<T>(),
                                     d_deviation.defined() ? d_deviation.data_ptr<T>() : nullptr,
                                     d_corners.data_ptr<T>(), d_alpha.data_ptr<T>(), d_beta.data_ptr<T>());
}

// Returns the values and, when asked for, the deviation.
class DualVertexFunction : public torch::autograd::Function<DualVertexFunction> {
 public:
  static variable_list forward(AutogradContext* context, const Tensor& rows, const Tensor& alpha, const Tensor& beta,
                               const Tensor& corners, const Tensor& corner_sources, const Tensor& cases,
                               const Tensor& first_dual, const Tensor& first_crossing, std::int64_t duals,
                               std::int64_t crossings, bool with_deviation) {
    RECORD_USER_SCOPE("surface extraction: dual vertices");
    const variable_list saved = {rows, alpha, beta, corners, corner_sources, cases, first_dual, first_crossing};
    context->save_for_backward(saved);
    const Tensor values = torch::empty({duals, rows.size(1) - 1}, rows.options());
    const Tensor deviation = with_deviation ? torch::empty({crossings}, rows.options()) : Tensor();
    if (rows.scalar_type() == torch::kFloat64) {
      run_forward<double>(saved, values, deviation);
    } else {
      run_forward<float>(saved, values, deviation);
    }
    return with_deviation ? variable_list{values, deviation} : variable_list{values};
  }

  static variable_list backward(AutogradContext* context, variable_list gradients) {
    RECORD_USER_SCOPE("surface extraction: dual vertices");
    const torch::autograd::variable_list saved = nn::saved_once(*context, "dual vertices");
    const Tensor& rows = saved[kRows];
    const Tensor d_values = gradients[0].contiguous();
    const Tensor d_deviation = gradients.size() > 1 ? gradients[1].contiguous() : Tensor();
    const Tensor d_corners = torch::empty({saved[kCorners].size(0), kCubeCorners, rows.size(1)}, rows.options());
    const Tensor d_alpha = torch::empty(saved[kAlpha].sizes(), rows.options());
    const Tensor d_beta = torch::empty(saved[kBeta].sizes(), rows.options());
    if (rows.scalar_type() == torch::kFloat64) {
      run_backward<double>(saved, d_values, d_deviation, d_corners, d_alpha, d_beta);
    } else {
      run_backward<float>(saved, d_values, d_deviation, d_corners, d_alpha, d_beta);
    }
    const RowLinks links{saved[kCorners].reshape({-1}), saved[kCornerSources]};
    variable_list result(11);
    result[0] = sum_rows(d_corners, links);
    result[1] = d_alpha;
    result[2] = d_beta;
    return result;
  }
};

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

DualVertices dual_vertices(const Tensor& rows, const Tensor& alpha, const Tensor& beta, const DualTopology& topology,
                           bool with_deviation) {
  TORCH_CHECK(rows.dim() == 2 && rows.size(0) == topology.vertex_places.size(0) && rows.size(1) >= 4,
              "values at grid vertices ", rows.sizes(), " for ", topology.vertex_places.size(0), " vertices");
  if (!rows.is_cpu()) return tensor_dual_vertices(rows, alpha, beta, topology, with_deviation);
  const variable_list found = DualVertexFunction::apply(
      rows.contiguous(), alpha.contiguous(), beta.contiguous(), topology.corners, topology.corner_sources,
      topology.cases, topology.first_dual, topology.first_crossing, topology.duals, topology.crossings, with_deviation);
  return {found[0], with_deviation ? found[1] : Tensor()};
}

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
  // Edge e = (a, b) with signed distances s and values x: w = s α, u_e = (x_a w_b − x_b w_a) / (w_b − w_a), and the
  // dual vertex is v_d = Σ β_e u_e / Σ β_e.
  const Tensor s_a = a.narrow(1, 0, 1), s_b = b.narrow(1, 0, 1);
  const Tensor x_a = a.narrow(1, 1, rows.size(1) - 1), x_b = b.narrow(1, 1, rows.size(1) - 1);
  const Tensor w_a = s_a * chosen(alpha, column(kAlphaA)), w_b = s_b * chosen(alpha, column(kAlphaB));
  const Tensor weight = chosen(beta, column(kBetaOf));

  DualVertices found;
  found.values = sum(weight * linear_zero(x_a, x_b, w_a, w_b)) / sum(weight);
  if (!with_deviation) return found;
  // L_dev: | ‖z_e − v_d‖ − mean over the edges of d |, with z_e the crossing without α.
  const Tensor zero = linear_zero(x_a.narrow(1, 0, 3), x_b.narrow(1, 0, 3), s_a, s_b);
  const Tensor distance = (zero - found.values.narrow(1, 0, 3).index_select(0, dual)).norm(2, 1, /*keepdim=*/true);
  const Tensor mean = sum(distance) / sum(torch::ones_like(distance));
  found.deviation = (distance - mean.index_select(0, dual)).abs().squeeze(1);
  return found;
}

}  // namespace anigen::shape_field
