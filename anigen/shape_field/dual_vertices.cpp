#include "anigen/shape_field/dual_vertices.h"

#include <ATen/Dispatch.h>
#include <ATen/Parallel.h>
#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "anigen/core/kernel_form.h"
#include "anigen/shape_field/grid.h"
#include "anigen/shape_field/row_links.h"

namespace anigen::shape_field {

namespace {

using torch::autograd::AutogradContext;
using torch::autograd::variable_list;

// Cubes that a surface passes, with what the field says at their corners. Row of a grid vertex: sdf, then `channels`
// values that are interpolated, the position first.
template <typename T>
struct DualCubes {
  std::int64_t cubes = 0, channels = 0;
  const T* rows = nullptr;                // [S, 1 + channels]
  const T* alpha = nullptr;               // [cubes, 8]
  const T* beta = nullptr;                // [cubes, 12]
  const std::int32_t* corners = nullptr;  // [cubes, 8]
  const std::uint8_t* cases = nullptr;    // [cubes]
  const std::int32_t* first_dual = nullptr;
  const std::int32_t* first_crossing = nullptr;
};

constexpr std::int64_t kCubesPerTask = 256;
constexpr int kMostEdges = FlexicubesTables::kMostEdges;

// Crossing of an edge with the surface: share_a · a + share_b · b, with shares that add up to 1.
template <typename T>
struct EdgeCrossing {
  int a = 0, b = 0;  // corners of the cube
  const T *row_a = nullptr, *row_b = nullptr;
  double share_a = 0.0, share_b = 0.0;
  double slope = 0.0;  // 1 / (w_b − w_a) of the weighted signed distances w
};

// Values of one group's edges, so that the passes over them do not look them up again.
template <typename T>
struct EdgeGroup {
  std::array<EdgeCrossing<T>, kMostEdges> weighted, plain;  // with and without alpha
  std::array<double, kMostEdges> beta{};
  std::array<int, kMostEdges> edge{};
  double beta_sum = 0.0;
  int size = 0;
};

template <typename T>
ANIGEN_KERNEL_INLINE EdgeCrossing<T> crossing(const DualCubes<T>& problem, std::int64_t cube, int edge, bool weighted) {
  const std::int64_t stride = 1 + problem.channels;
  EdgeCrossing<T> found;
  found.a = kEdgeCorners[static_cast<std::size_t>(edge)][0];
  found.b = kEdgeCorners[static_cast<std::size_t>(edge)][1];
  const std::int64_t first = cube * kCubeCorners;
  found.row_a = problem.rows + problem.corners[first + found.a] * stride;
  found.row_b = problem.rows + problem.corners[first + found.b] * stride;
  const double alpha_a = weighted ? static_cast<double>(problem.alpha[first + found.a]) : 1.0;
  const double alpha_b = weighted ? static_cast<double>(problem.alpha[first + found.b]) : 1.0;
  const double w_a = alpha_a * static_cast<double>(found.row_a[0]);
  const double w_b = alpha_b * static_cast<double>(found.row_b[0]);
  found.slope = 1.0 / (w_b - w_a);
  found.share_a = w_b * found.slope;
  found.share_b = -w_a * found.slope;
  return found;
}

template <typename T>
ANIGEN_KERNEL_INLINE EdgeGroup<T> edge_group(const DualCubes<T>& problem, std::int64_t cube, std::size_t group,
                                             bool with_plain) {
  const auto& edges = flexicubes_tables().groups[problem.cases[cube]][group];
  EdgeGroup<T> found;
  for (const std::int16_t edge : edges) {
    if (edge < 0) break;
    const auto i = static_cast<std::size_t>(found.size++);
    found.edge[i] = edge;
    found.beta[i] = static_cast<double>(problem.beta[cube * kCubeEdges + edge]);
    found.beta_sum += found.beta[i];
    found.weighted[i] = crossing(problem, cube, edge, true);
    if (with_plain) found.plain[i] = crossing(problem, cube, edge, false);
  }
  return found;
}

// Mean of the edge points, weighted with beta.
template <typename T>
ANIGEN_KERNEL_INLINE void dual_vertex(const EdgeGroup<T>& group, std::int64_t channels, T* value) {
  std::fill_n(value, channels, T(0));
  for (int i = 0; i < group.size; ++i) {
    const auto at_edge = static_cast<std::size_t>(i);
    const EdgeCrossing<T>& edge = group.weighted[at_edge];
    const T share_a = static_cast<T>(group.beta[at_edge] / group.beta_sum * edge.share_a);
    const T share_b = static_cast<T>(group.beta[at_edge] / group.beta_sum * edge.share_b);
    for (std::int64_t c = 0; c < channels; ++c) value[c] += share_a * edge.row_a[1 + c] + share_b * edge.row_b[1 + c];
  }
}

// From a dual vertex to the zero crossings of its edges.
template <typename T>
struct Distances {
  ANIGEN_KERNEL_INLINE Distances(const EdgeGroup<T>& group, const T* vertex) {
    for (int i = 0; i < group.size; ++i) {
      const auto at_edge = static_cast<std::size_t>(i);
      const EdgeCrossing<T>& edge = group.plain[at_edge];
      double square = 0.0;
      for (std::size_t axis = 0; axis < 3; ++axis) {
        const double zero = edge.share_a * static_cast<double>(edge.row_a[1 + axis]) +
                            edge.share_b * static_cast<double>(edge.row_b[1 + axis]);
        difference[at_edge][axis] = zero - static_cast<double>(vertex[axis]);
        square += difference[at_edge][axis] * difference[at_edge][axis];
      }
      length[at_edge] = std::sqrt(square);
      mean += length[at_edge];
    }
    mean /= group.size;
  }

  std::array<std::array<double, 3>, kMostEdges> difference{};
  std::array<double, kMostEdges> length{};
  double mean = 0.0;
};

// Adds what flows into a crossing to the values of its two corners. With the result r the weighted signed distances get
// slope · share_a · r and slope · share_b · r, since u − b = share_a (a − b) and a − u = share_b (a − b).
// @param direction gradient of the first `channels` values of the crossing @return r = ⟨direction, a − b⟩
template <typename T, typename Direction>
ANIGEN_KERNEL_INLINE double spread(const EdgeCrossing<T>& edge, std::int64_t channels, const Direction& direction,
                                   T* d_row_a, T* d_row_b) {
  for (std::int64_t c = 0; c < channels; ++c) {
    d_row_a[1 + c] += static_cast<T>(edge.share_a * direction(c));
    d_row_b[1 + c] += static_cast<T>(edge.share_b * direction(c));
  }
  std::array<double, 2> along{};  // side by side
  for (std::int64_t c = 0; c < channels; ++c) {
    along[static_cast<std::size_t>(c % 2)] +=
        direction(c) * (static_cast<double>(edge.row_a[1 + c]) - static_cast<double>(edge.row_b[1 + c]));
  }
  return along[0] + along[1];
}

// Scratch of one thread.
template <typename T>
struct DualScratch {
  explicit DualScratch(std::int64_t channels)
      : value(static_cast<std::size_t>(channels)), gradient(static_cast<std::size_t>(channels)) {}
  std::vector<T> value, gradient;
};

// Destination of the gradients of one cube.
template <typename T>
struct CubeGradients {
  T *corners, *alpha, *beta;
  T* row(int corner, std::int64_t channels) const { return corners + corner * (1 + channels); }
};

// The deviation |d_i − mean d| of a group: what it adds to the gradient of the vertex and of the corners.
template <typename T>
ANIGEN_KERNEL_INLINE void deviation_backward(const EdgeGroup<T>& group, std::int64_t channels, const T* vertex,
                                             const T* d_deviation, T* d_vertex, const CubeGradients<T>& out) {
  const Distances<T> distances(group, vertex);
  std::array<double, kMostEdges> d_length{};
  double sum = 0.0;
  for (std::size_t i = 0; i < static_cast<std::size_t>(group.size); ++i) {
    const double off = distances.length[i] - distances.mean;
    const double sign = off > 0.0 ? 1.0 : off < 0.0 ? -1.0 : 0.0;
    d_length[i] = sign * static_cast<double>(d_deviation[i]);
    sum += d_length[i];
  }
  for (std::size_t i = 0; i < static_cast<std::size_t>(group.size); ++i) {
    if (!(distances.length[i] > 0.0)) continue;  // a vertex on its crossing has no direction
    const double scale = (d_length[i] - sum / group.size) / distances.length[i];
    const EdgeCrossing<T>& edge = group.plain[i];
    const auto direction = [&](std::int64_t c) { return scale * distances.difference[i][static_cast<std::size_t>(c)]; };
    for (std::int64_t axis = 0; axis < 3; ++axis) d_vertex[axis] -= static_cast<T>(direction(axis));
    T *row_a = out.row(edge.a, channels), *row_b = out.row(edge.b, channels);
    const double along = edge.slope * spread(edge, 3, direction, row_a, row_b);
    row_a[0] += static_cast<T>(edge.share_a * along);
    row_b[0] += static_cast<T>(edge.share_b * along);
  }
}

template <typename T>
ANIGEN_KERNEL_INLINE void group_backward(const DualCubes<T>& problem, std::int64_t cube, std::size_t group_index,
                                         const T* d_values, const T* d_deviation, DualScratch<T>& scratch,
                                         const CubeGradients<T>& out) {
  const std::int64_t channels = problem.channels;
  const EdgeGroup<T> group = edge_group(problem, cube, group_index, d_deviation != nullptr);
  T* d_vertex = scratch.gradient.data();
  std::copy_n(d_values, channels, d_vertex);
  dual_vertex(group, channels, scratch.value.data());
  if (d_deviation != nullptr) deviation_backward(group, channels, scratch.value.data(), d_deviation, d_vertex, out);
  for (std::size_t i = 0; i < static_cast<std::size_t>(group.size); ++i) {
    const EdgeCrossing<T>& edge = group.weighted[i];
    const double share = group.beta[i] / group.beta_sum;
    double d_beta = 0.0;
    for (std::int64_t c = 0; c < channels; ++c) {
      const double point =
          edge.share_a * static_cast<double>(edge.row_a[1 + c]) + edge.share_b * static_cast<double>(edge.row_b[1 + c]);
      d_beta +=
          static_cast<double>(d_vertex[c]) * (point - static_cast<double>(scratch.value[static_cast<std::size_t>(c)]));
    }
    out.beta[group.edge[i]] += static_cast<T>(d_beta / group.beta_sum);
    T *row_a = out.row(edge.a, channels), *row_b = out.row(edge.b, channels);
    const auto direction = [&](std::int64_t c) { return share * static_cast<double>(d_vertex[c]); };
    const double along = edge.slope * spread(edge, channels, direction, row_a, row_b);
    const double d_w_a = edge.share_a * along, d_w_b = edge.share_b * along;
    const std::int64_t first = cube * kCubeCorners;
    row_a[0] += static_cast<T>(d_w_a * static_cast<double>(problem.alpha[first + edge.a]));
    row_b[0] += static_cast<T>(d_w_b * static_cast<double>(problem.alpha[first + edge.b]));
    out.alpha[edge.a] += static_cast<T>(d_w_a * static_cast<double>(edge.row_a[0]));
    out.alpha[edge.b] += static_cast<T>(d_w_b * static_cast<double>(edge.row_b[0]));
  }
}

std::size_t group_count(std::uint8_t cube_case) {
  return static_cast<std::size_t>(flexicubes_tables().counts[cube_case]);
}

// Dual vertices and, unless `deviation` is nullptr, the deviation of every (dual vertex, edge)
// (docs/reference/autoencoders.md, 5.2). Parallel over cubes. @param values [D, channels] @param deviation [K]
template <typename T>
void dual_vertices_forward(const DualCubes<T>& problem, T* values, T* deviation) {
  at::parallel_for(0, problem.cubes, kCubesPerTask, [&](std::int64_t begin, std::int64_t end) {
    for (std::int64_t cube = begin; cube < end; ++cube) {
      T* value = values + problem.first_dual[cube] * problem.channels;
      T* deviations = deviation == nullptr ? nullptr : deviation + problem.first_crossing[cube];
      for (std::size_t g = 0; g < group_count(problem.cases[cube]); ++g, value += problem.channels) {
        const EdgeGroup<T> group = edge_group(problem, cube, g, deviation != nullptr);
        dual_vertex(group, problem.channels, value);
        if (deviation == nullptr) continue;
        const Distances<T> distances(group, value);
        for (std::size_t i = 0; i < static_cast<std::size_t>(group.size); ++i)
          *deviations++ = static_cast<T>(std::abs(distances.length[i] - distances.mean));
      }
    }
  });
}

// Sources and places of the gradients of dual_vertices_forward. @param d_deviation may be nullptr
// @param d_corners [cubes, 8, 1 + channels] @param d_alpha [cubes, 8] @param d_beta [cubes, 12]; all three overwritten
template <typename T>
struct DualGradients {
  const T *d_values, *d_deviation;
  T *d_corners, *d_alpha, *d_beta;
};

template <typename T>
ANIGEN_KERNEL_INLINE void gradients_of_cubes(const DualCubes<T>& problem, const DualGradients<T>& gradients,
                                             std::int64_t begin, std::int64_t end, DualScratch<T>& scratch) {
  const std::int64_t channels = problem.channels, cube_values = kCubeCorners * (1 + channels);
  const FlexicubesTables& tables = flexicubes_tables();
  for (std::int64_t cube = begin; cube < end; ++cube) {
    const CubeGradients<T> out{gradients.d_corners + cube * cube_values, gradients.d_alpha + cube * kCubeCorners,
                               gradients.d_beta + cube * kCubeEdges};
    std::fill_n(out.corners, cube_values, T(0));
    std::fill_n(out.alpha, kCubeCorners, T(0));
    std::fill_n(out.beta, kCubeEdges, T(0));
    const T* d_value = gradients.d_values + problem.first_dual[cube] * channels;
    const T* d_dev = gradients.d_deviation == nullptr ? nullptr : gradients.d_deviation + problem.first_crossing[cube];
    const std::uint8_t cube_case = problem.cases[cube];
    for (std::size_t g = 0; g < static_cast<std::size_t>(tables.counts[cube_case]); ++g, d_value += channels) {
      group_backward(problem, cube, g, d_value, d_dev, scratch, out);
      if (d_dev == nullptr) continue;
      for (const std::int16_t edge : tables.groups[cube_case][g]) d_dev += edge >= 0 ? 1 : 0;
    }
  }
}

ANIGEN_KERNEL(void, backward_of_cubes,
              (const DualCubes<float>& problem, const DualGradients<float>& gradients, std::int64_t begin,
               std::int64_t end, DualScratch<float>& scratch),
              (problem, gradients, begin, end, scratch)) {
  gradients_of_cubes(problem, gradients, begin, end, scratch);
}

void backward_of_cubes(const DualCubes<double>& problem, const DualGradients<double>& gradients, std::int64_t begin,
                       std::int64_t end, DualScratch<double>& scratch) {
  gradients_of_cubes(problem, gradients, begin, end, scratch);
}

// Cube by cube, by all threads.
template <typename T>
void dual_vertices_backward(const DualCubes<T>& problem, const DualGradients<T>& gradients) {
  at::parallel_for(0, problem.cubes, kCubesPerTask, [&](std::int64_t begin, std::int64_t end) {
    DualScratch<T> scratch(problem.channels);
    backward_of_cubes(problem, gradients, begin, end, scratch);
  });
}

// Topology as the kernels need it, as tensors that a backward pass can keep.
enum SavedTensor : std::size_t { kRows, kAlpha, kBeta, kCorners, kCornerSources, kCases, kFirstDual, kFirstCrossing };

template <typename T>
DualCubes<T> dual_cubes(const variable_list& saved) {
  DualCubes<T> problem;
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
    AT_DISPATCH_FLOATING_TYPES(rows.scalar_type(), "dual_vertices", [&] {
      dual_vertices_forward(dual_cubes<scalar_t>(saved), values.data_ptr<scalar_t>(),
                            with_deviation ? deviation.data_ptr<scalar_t>() : nullptr);
    });
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
    AT_DISPATCH_FLOATING_TYPES(rows.scalar_type(), "dual_vertices_backward", [&] {
      dual_vertices_backward<scalar_t>(
          dual_cubes<scalar_t>(saved),
          {d_values.data_ptr<scalar_t>(), d_deviation.defined() ? d_deviation.data_ptr<scalar_t>() : nullptr,
           d_corners.data_ptr<scalar_t>(), d_alpha.data_ptr<scalar_t>(), d_beta.data_ptr<scalar_t>()});
    });
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
