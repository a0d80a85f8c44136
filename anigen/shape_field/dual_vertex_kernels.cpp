#include "anigen/shape_field/dual_vertex_kernels.h"

#include <ATen/Parallel.h>
#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "anigen/shape_field/flexicubes.h"
#include "anigen/shape_field/grid.h"

namespace anigen::shape_field {

namespace {

using torch::autograd::AutogradContext;
using torch::autograd::variable_list;

constexpr std::int64_t kLinksPerTask = 1 << 12;

void require_table(const Tensor& values) {
  TORCH_CHECK(values.scalar_type() == torch::kFloat32 || values.scalar_type() == torch::kFloat64, "rows of type ",
              values.dtype(), "; expected fp32 or fp64");
}

// Rows whose channels are adjacent in memory; a single channel always is.
Tensor with_adjacent_channels(const Tensor& x) { return x.size(-1) <= 1 || x.stride(-1) == 1 ? x : x.contiguous(); }

template <typename T>
void gather_kernel(const Tensor& table, const Tensor& targets, const Tensor& out) {
  const T* rows = table.data_ptr<T>();
  const std::int64_t* target = targets.data_ptr<std::int64_t>();
  T* values = out.data_ptr<T>();
  const std::int64_t channels = table.size(1), stride = table.stride(0);
  at::parallel_for(0, targets.size(0), kLinksPerTask, [&](std::int64_t begin, std::int64_t end) {
    for (std::int64_t i = begin; i < end; ++i) {
      if (target[i] < 0) {
        std::fill_n(values + i * channels, channels, T(0));
      } else {
        std::copy_n(rows + target[i] * stride, channels, values + i * channels);
      }
    }
  });
}

template <typename T>
void sum_kernel(const Tensor& list, const Tensor& sources, const Tensor& out) {
  const T* entries = list.data_ptr<T>();
  const std::int32_t* source = sources.data_ptr<std::int32_t>();
  T* sums = out.data_ptr<T>();
  const std::int64_t channels = list.size(2), slots = sources.size(1);
  const std::int64_t outer = list.stride(0), inner = list.stride(1);
  const auto group = static_cast<std::int32_t>(std::max<std::int64_t>(1, list.size(1)));
  at::parallel_for(0, sources.size(0), kLinksPerTask, [&](std::int64_t begin, std::int64_t end) {
    for (std::int64_t row = begin; row < end; ++row) {
      T* sum = sums + row * channels;
      std::fill_n(sum, channels, T(0));
      for (std::int64_t slot = 0; slot < slots; ++slot) {
        const std::int32_t entry = source[row * slots + slot];
        if (entry < 0) continue;
        const T* values = entries + entry / group * outer + entry % group * inner;
        for (std::int64_t c = 0; c < channels; ++c) sum[c] += values[c];
      }
    }
  });
}

// index_select for other devices, with zeros where the index is negative.
Tensor select_or_zero(const Tensor& rows, const Tensor& index) {
  if (rows.size(0) == 0) return torch::zeros({index.size(0), rows.size(1)}, rows.options());
  return rows.index_select(0, index.clamp_min(0)).masked_fill_((index < 0).unsqueeze(1), 0);
}

Tensor gathered(const Tensor& table, const Tensor& targets) {
  if (!table.is_cpu()) return select_or_zero(table, targets);
  const Tensor rows = with_adjacent_channels(table), index = targets.contiguous();
  const Tensor out = torch::empty({index.size(0), rows.size(1)}, rows.options());
  if (rows.scalar_type() == torch::kFloat64) {
    gather_kernel<double>(rows, index, out);
  } else {
    gather_kernel<float>(rows, index, out);
  }
  return out;
}

Tensor summed(const Tensor& list, const Tensor& sources) {
  const std::int64_t channels = list.size(-1);
  if (!list.is_cpu()) {
    const Tensor rows = list.reshape({list.dim() == 3 ? list.size(0) * list.size(1) : list.size(0), channels});
    Tensor out = torch::zeros({sources.size(0), channels}, list.options());
    for (std::int64_t slot = 0; slot < sources.size(1); ++slot)
      out = out + select_or_zero(rows, sources.select(1, slot).to(torch::kInt64));
    return out;
  }
  const Tensor entries = with_adjacent_channels(list.dim() == 3 ? list : list.unsqueeze(1));
  const Tensor slots = sources.contiguous();
  const Tensor out = torch::empty({slots.size(0), channels}, list.options());
  if (list.scalar_type() == torch::kFloat64) {
    sum_kernel<double>(entries, slots, out);
  } else {
    sum_kernel<float>(entries, slots, out);
  }
  return out;
}

class GatherRows : public torch::autograd::Function<GatherRows> {
 public:
  static Tensor forward(AutogradContext* context, const Tensor& table, const Tensor& targets, const Tensor& sources) {
    context->save_for_backward({targets, sources});
    return gathered(table, targets);
  }
  static variable_list backward(AutogradContext* context, variable_list gradients) {
    const variable_list saved = context->get_saved_variables();
    return {sum_rows(gradients[0], RowLinks{saved[0], saved[1]}), Tensor(), Tensor()};
  }
};

class SumRows : public torch::autograd::Function<SumRows> {
 public:
  static Tensor forward(AutogradContext* context, const Tensor& list, const Tensor& targets, const Tensor& sources) {
    context->save_for_backward({targets, sources});
    context->saved_data["shape"] = list.sizes().vec();
    return summed(list, sources);
  }
  static variable_list backward(AutogradContext* context, variable_list gradients) {
    const variable_list saved = context->get_saved_variables();
    const Tensor entries = gather_rows(gradients[0], RowLinks{saved[0], saved[1]});
    return {entries.view(context->saved_data["shape"].toIntVector()), Tensor(), Tensor()};
  }
};

}  // namespace

Tensor gather_rows(const Tensor& table, const RowLinks& links) {
  require_table(table);
  TORCH_CHECK(table.dim() == 2 && table.size(0) == links.sources.size(0), "a table ", table.sizes(), " for ",
              links.sources.size(0), " rows");
  return GatherRows::apply(table, links.targets, links.sources);
}

Tensor sum_rows(const Tensor& list, const RowLinks& links) {
  require_table(list);
  TORCH_CHECK((list.dim() == 2 && list.size(0) == links.targets.size(0)) ||
                  (list.dim() == 3 && list.size(0) * list.size(1) == links.targets.size(0)),
              "a list ", list.sizes(), " for ", links.targets.size(0), " entries");
  return SumRows::apply(list, links.targets, links.sources);
}

}  // namespace anigen::shape_field

namespace anigen::shape_field::kernels {

namespace {

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
EdgeCrossing<T> crossing(const DualCubes<T>& problem, std::int64_t cube, int edge, bool weighted) {
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
EdgeGroup<T> edge_group(const DualCubes<T>& problem, std::int64_t cube, std::size_t group, bool with_plain) {
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
void dual_vertex(const EdgeGroup<T>& group, std::int64_t channels, T* value) {
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
  Distances(const EdgeGroup<T>& group, const T* vertex) {
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
double spread(const EdgeCrossing<T>& edge, std::int64_t channels, const Direction& direction, T* d_row_a, T* d_row_b) {
  double along = 0.0;
  for (std::int64_t c = 0; c < channels; ++c) {
    const double d = static_cast<double>(direction(c));
    d_row_a[1 + c] += static_cast<T>(edge.share_a * d);
    d_row_b[1 + c] += static_cast<T>(edge.share_b * d);
    along += d * (static_cast<double>(edge.row_a[1 + c]) - static_cast<double>(edge.row_b[1 + c]));
  }
  return along;
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
void deviation_backward(const EdgeGroup<T>& group, std::int64_t channels, const T* vertex, const T* d_deviation,
                        T* d_vertex, const CubeGradients<T>& out) {
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
void group_backward(const DualCubes<T>& problem, std::int64_t cube, std::size_t group_index, const T* d_values,
                    const T* d_deviation, DualScratch<T>& scratch, const CubeGradients<T>& out) {
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

}  // namespace

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

template <typename T>
void dual_vertices_backward(const DualCubes<T>& problem, const T* d_values, const T* d_deviation, T* d_corners,
                            T* d_alpha, T* d_beta) {
  const std::int64_t channels = problem.channels, cube_values = kCubeCorners * (1 + channels);
  at::parallel_for(0, problem.cubes, kCubesPerTask, [&](std::int64_t begin, std::int64_t end) {
    DualScratch<T> scratch(channels);
    for (std::int64_t cube = begin; cube < end; ++cube) {
      const CubeGradients<T> out{d_corners + cube * cube_values, d_alpha + cube * kCubeCorners,
                                 d_beta + cube * kCubeEdges};
      std::fill_n(out.corners, cube_values, T(0));
      std::fill_n(out.alpha, kCubeCorners, T(0));
      std::fill_n(out.beta, kCubeEdges, T(0));
      const T* d_value = d_values + problem.first_dual[cube] * channels;
      const T* d_dev = d_deviation == nullptr ? nullptr : d_deviation + problem.first_crossing[cube];
      for (std::size_t g = 0; g < group_count(problem.cases[cube]); ++g, d_value += channels) {
        group_backward(problem, cube, g, d_value, d_dev, scratch, out);
        if (d_dev == nullptr) continue;
        for (const std::int16_t edge : flexicubes_tables().groups[problem.cases[cube]][g]) d_dev += edge >= 0 ? 1 : 0;
      }
    }
  });
}

template void dual_vertices_forward<float>(const DualCubes<float>&, float*, float*);
template void dual_vertices_forward<double>(const DualCubes<double>&, double*, double*);
template void dual_vertices_backward<float>(const DualCubes<float>&, const float*, const float*, float*, float*,
                                            float*);
template void dual_vertices_backward<double>(const DualCubes<double>&, const double*, const double*, double*, double*,
                                             double*);

}  // namespace anigen::shape_field::kernels
