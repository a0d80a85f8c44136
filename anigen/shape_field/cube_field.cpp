#include "anigen/shape_field/cube_field.h"

#include <ATen/Dispatch.h>
#include <ATen/Parallel.h>
#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>
#include <string>
#include <utility>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/nn/init.h"
#include "anigen/nn/kernels/tiles.h"
#include "anigen/shape_field/grid.h"
#include "anigen/shape_field/row_links.h"

namespace anigen::shape_field {

namespace {

void require_shape(const char* what, const Tensor& tensor, torch::IntArrayRef shape, const Tensor& like) {
  bool fits = tensor.defined() && tensor.dim() == static_cast<std::int64_t>(shape.size());
  for (std::size_t i = 0; fits && i < shape.size(); ++i)
    fits = shape[i] < 0 || tensor.size(static_cast<std::int64_t>(i)) == shape[i];
  if (!fits)
    throw InputError("", what, "expected " + nn::shape_text(shape) + " (-1: any), found " + nn::shape_text(tensor));
  if (tensor.scalar_type() != like.scalar_type() || tensor.device() != like.device())
    throw InputError("", what, "must have the type and device of the signed distances");
}

void require_places(const Tensor& coords, std::int64_t resolution) {
  if (resolution < 1 || resolution > kMostCubeResolution) {
    throw InputError(
        "", "resolution",
        "must be in [1, " + std::to_string(kMostCubeResolution) + "], found " + std::to_string(resolution));
  }
  const bool places = coords.defined() && coords.dim() == 2 && coords.size(1) == 3 &&
                      (coords.scalar_type() == torch::kInt32 || coords.scalar_type() == torch::kInt64);
  if (!places) throw InputError("", "coords", "expected integers [C, 3], found " + nn::shape_text(coords));
}

void require_corners(const CubeCorners& corners, std::int64_t resolution) {
  require_places(corners.coords, resolution);
  if (!corners.sdf.defined() ||
      (corners.sdf.scalar_type() != torch::kFloat32 && corners.sdf.scalar_type() != torch::kFloat64)) {
    throw InputError("", "sdf", "expected fp32 or fp64");
  }
  const std::int64_t cubes = corners.coords.size(0);
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
  const Tensor places = coords.to(torch::kCPU, torch::kInt64).contiguous();
  const std::int64_t* place = places.data_ptr<std::int64_t>();
  for (std::int64_t i = 0; i < places.numel(); ++i) {
    if (place[i] >= 0 && place[i] < resolution) continue;
    throw InputError("", "coords row " + std::to_string(i / 3),
                     "cube outside the grid of resolution " + std::to_string(resolution));
  }
  const std::vector<std::int64_t> numbers = grid_numbers(places, grid);
  SortedCubes sorted{{}, sorting_order(numbers)};
  sorted.numbers.reserve(numbers.size());
  for (const std::int32_t row : sorted.rows) {
    const std::int64_t number = numbers[static_cast<std::size_t>(row)];
    if (!sorted.numbers.empty() && sorted.numbers.back() == number)
      throw InputError("", "coords row " + std::to_string(row), "a cube that is there twice");
    sorted.numbers.push_back(number);
  }
  return sorted;
}

// Vertex of each corner: targets by cube and corner, sources with one slot per corner number.
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

using torch::autograd::AutogradContext;
using torch::autograd::variable_list;

constexpr std::int64_t kVerticesPerTask = 1 << 12, kVerticesAhead = 4;

// Corner values [C, 8, ch] with any strides between cubes and corners, and the means [V, ch] to write.
template <typename T>
struct CornerPart {
  CornerPart(const Tensor& corners, const Tensor& means)
      : corner(corners.data_ptr<T>()),
        mean(means.data_ptr<T>()),
        cube_stride(corners.stride(0)),
        corner_stride(corners.stride(1)),
        channels(corners.size(2)) {}

  const T* at(std::int64_t cube, std::int64_t k) const { return corner + cube * cube_stride + k * corner_stride; }

  const T* corner;
  T* mean;
  std::int64_t cube_stride, corner_stride, channels;
};

// Means of all parts in one pass over the vertices. @param sources [V, 8], slot k the corner with number k
// @param counts [V, 1] filled with the number of corners
template <typename T>
void mean_kernel(const std::array<CornerPart<T>, 3>& parts, const Tensor& sources, const Tensor& counts) {
  const std::int32_t* source = sources.data_ptr<std::int32_t>();
  T* count_of = counts.data_ptr<T>();
  at::parallel_for(0, sources.size(0), kVerticesPerTask, [&](std::int64_t begin, std::int64_t end) {
    for (std::int64_t vertex = begin; vertex < end; ++vertex) {
      // The values of a vertex lie far apart in memory, so that they are asked for ahead of time.
      for (std::int64_t slot = (vertex + kVerticesAhead) * kCubeCorners, k = 0; k < kCubeCorners; ++k) {
        const std::int32_t entry = vertex + kVerticesAhead < end ? source[slot + k] : -1;
        if (entry < 0) continue;
        for (const CornerPart<T>& part : parts) {
          const T* value = part.at(entry / kCubeCorners, k);
          __builtin_prefetch(value);
          __builtin_prefetch(value + std::max<std::int64_t>(part.channels, 1) - 1);
        }
      }
      int count = 0;
      for (const CornerPart<T>& part : parts) std::fill_n(part.mean + vertex * part.channels, part.channels, T(0));
      for (std::int64_t k = 0; k < kCubeCorners; ++k) {
        const std::int32_t entry = source[vertex * kCubeCorners + k];
        if (entry < 0) continue;
        ++count;
        for (const CornerPart<T>& part : parts) {
          const T* value = part.at(entry / kCubeCorners, k);
          T* mean = part.mean + vertex * part.channels;
          for (std::int64_t c = 0; c < part.channels; ++c) mean[c] += value[c];
        }
      }
      count_of[vertex] = static_cast<T>(count);
      for (const CornerPart<T>& part : parts) {
        T* mean = part.mean + vertex * part.channels;
        for (std::int64_t c = 0; c < part.channels; ++c) mean[c] /= count_of[vertex];
      }
    }
  });
}

// Means at vertices of three groups of corner values, all on the CPU.
class CornerMeans : public torch::autograd::Function<CornerMeans> {
 public:
  static variable_list forward(AutogradContext* context, const Tensor& a, const Tensor& b, const Tensor& c,
                               const Tensor& targets, const Tensor& sources) {
    const auto like = [&](const Tensor& x) { return torch::empty({sources.size(0), x.size(2)}, x.options()); };
    const variable_list means = {like(a), like(b), like(c)};
    const Tensor counts = torch::empty({sources.size(0), 1}, a.options());
    AT_DISPATCH_FLOATING_TYPES(a.scalar_type(), "corner_means", [&] {
      mean_kernel<scalar_t>(
          {CornerPart<scalar_t>(a, means[0]), CornerPart<scalar_t>(b, means[1]), CornerPart<scalar_t>(c, means[2])},
          sources, counts);
    });
    context->save_for_backward({targets, sources, counts});
    context->set_materialize_grads(false);  // fields without a surface use one of the three
    return means;
  }
  static variable_list backward(AutogradContext* context, variable_list gradients) {
    const variable_list saved = context->get_saved_variables();
    variable_list result(5);
    for (std::size_t i = 0; i < gradients.size(); ++i) {
      if (!gradients[i].defined()) continue;
      const Tensor entries = gather_rows(gradients[i] / saved[2], RowLinks{saved[0], saved[1]});
      result[i] = entries.view({-1, kCubeCorners, gradients[i].size(1)});
    }
    return result;
  }
};

constexpr std::int64_t kCubesPerSum = 2048;  // partial sums have this length for any number of threads

// Corner values [C, 8, ch] beside the means [V, ch] they belong to.
template <typename T>
struct CornerValues {
  CornerValues(const Tensor& corners, const Tensor& means, const Tensor& vertices)
      : corner(corners.data_ptr<T>()),
        mean(means.data_ptr<T>()),
        vertex(vertices.data_ptr<std::int64_t>()),
        cube_stride(corners.stride(0)),
        corner_stride(corners.stride(1)),
        mean_stride(means.stride(0)),
        channels(corners.size(2)) {}

  // body(position in a dense [C, 8, ch] tensor, deviation from the mean)
  template <typename Body>
  void for_cubes(std::int64_t begin, std::int64_t end, const Body& body) const {
    for (std::int64_t entry = begin * kCubeCorners; entry < end * kCubeCorners; ++entry) {
      const T* values = corner + entry / kCubeCorners * cube_stride + entry % kCubeCorners * corner_stride;
      const T* means = mean + vertex[entry] * mean_stride;
      for (std::int64_t c = 0; c < channels; ++c) body(entry * channels + c, values[c] - means[c]);
    }
  }

  // One sum per corner number, so that additions need not wait for each other.
  double sum_of_squares(std::int64_t begin, std::int64_t end) const {
    std::array<double, kCubeCorners> sums{};
    std::array<const T*, kCubeCorners> value{}, center{};
    for (std::int64_t cube = begin; cube < end; ++cube) {
      for (std::int64_t k = 0; k < kCubeCorners; ++k) {
        value[static_cast<std::size_t>(k)] = corner + cube * cube_stride + k * corner_stride;
        center[static_cast<std::size_t>(k)] = mean + vertex[cube * kCubeCorners + k] * mean_stride;
      }
      for (std::int64_t c = 0; c < channels; ++c) {
        for (std::size_t k = 0; k < kCubeCorners; ++k) {
          const auto deviation = static_cast<double>(value[k][c] - center[k][c]);
          sums[k] += deviation * deviation;
        }
      }
    }
    double total = 0.0;
    for (const double sum : sums) total += sum;
    return total;
  }

  const T *corner, *mean;
  const std::int64_t* vertex;
  std::int64_t cube_stride, corner_stride, mean_stride, channels;
};

template <typename T>
double sum_of_squares(const Tensor& corners, const Tensor& means, const Tensor& vertices) {
  const CornerValues<T> values(corners, means, vertices);
  const std::int64_t cubes = corners.size(0), parts = (cubes + kCubesPerSum - 1) / kCubesPerSum;
  std::vector<double> sums(static_cast<std::size_t>(parts), 0.0);
  at::parallel_for(0, parts, 1, [&](std::int64_t begin, std::int64_t end) {
    for (std::int64_t part = begin; part < end; ++part) {
      sums[static_cast<std::size_t>(part)] =
          values.sum_of_squares(part * kCubesPerSum, std::min(cubes, (part + 1) * kCubesPerSum));
    }
  });
  double total = 0.0;
  for (const double sum : sums) total += sum;
  return total;
}

template <typename T>
void scaled_deviations(const Tensor& corners, const Tensor& means, const Tensor& vertices, double scale,
                       const Tensor& out) {
  const CornerValues<T> values(corners, means, vertices);
  T* result = out.data_ptr<T>();
  at::parallel_for(0, corners.size(0), kCubesPerSum, [&](std::int64_t begin, std::int64_t end) {
    values.for_cubes(begin, end,
                     [&](std::int64_t at_value, T deviation) { result[at_value] = static_cast<T>(scale) * deviation; });
  });
}

// corner − mean as a tensor, for devices without the kernels above.
Tensor deviations(const Tensor& corners, const Tensor& means, const Tensor& vertices) {
  return corners - means.index_select(0, vertices.reshape({-1})).view(corners.sizes());
}

class CornerDeviation : public torch::autograd::Function<CornerDeviation> {
 public:
  static Tensor forward(AutogradContext* context, const Tensor& corners, const Tensor& means, const Tensor& vertices) {
    RECORD_USER_SCOPE("surface extraction: corner consistency");
    context->save_for_backward({corners, means, vertices});
    if (!corners.is_cpu()) return deviations(corners, means, vertices).square().sum();
    const double sum = corners.scalar_type() == torch::kFloat64 ? sum_of_squares<double>(corners, means, vertices)
                                                                : sum_of_squares<float>(corners, means, vertices);
    return torch::full({}, sum, corners.options());
  }
  static variable_list backward(AutogradContext* context, variable_list gradients) {
    RECORD_USER_SCOPE("surface extraction: corner consistency");
    const torch::autograd::variable_list saved = nn::saved_once(*context, "the corner consistency");
    const Tensor &corners = saved[0], &means = saved[1], &vertices = saved[2];
    if (!corners.is_cpu()) {
      return {2.0 * gradients[0] * deviations(corners, means, vertices), Tensor(), Tensor()};
    }
    const double scale = 2.0 * gradients[0].item<double>();
    const Tensor out = torch::empty(corners.sizes(), corners.options());
    AT_DISPATCH_FLOATING_TYPES(corners.scalar_type(), "scaled_deviations",
                               [&] { scaled_deviations<scalar_t>(corners, means, vertices, scale, out); });
    return {out, Tensor(), Tensor()};
  }
};

// The kernels step through channels one by one.
Tensor adjacent(const Tensor& x) { return x.size(-1) <= 1 || x.stride(-1) == 1 ? x : x.contiguous(); }

// @return sdf [V, 1], deformation [V, 3] and attributes [V, A]
std::vector<Tensor> corner_means(const CubeCorners& corners, const RowLinks& links) {
  const Tensor sdf = corners.sdf.unsqueeze(-1);
  if (sdf.is_cpu()) {
    return CornerMeans::apply(sdf, adjacent(corners.deform), adjacent(corners.attributes), links.targets,
                              links.sources);
  }
  const Tensor counts = links.sources.ge(0).sum(1, /*keepdim=*/true).to(sdf.scalar_type());
  const auto mean = [&](const Tensor& values) { return sum_rows(values, links) / counts; };
  return {mean(sdf), mean(corners.deform), mean(corners.attributes)};
}

Tensor squared_deviation(const Tensor& corners, const Tensor& means, const Tensor& vertices) {
  TORCH_CHECK(corners.dim() == 3 && corners.size(0) == vertices.size(0) && corners.size(2) == means.size(1), "corners ",
              corners.sizes(), " beside averaged values ", means.sizes());
  return CornerDeviation::apply(adjacent(corners), adjacent(means.detach()), vertices);
}

ANIGEN_KERNEL(void, sigmoids, (const float* __restrict x, std::int64_t n, float* __restrict y), (x, n, y)) {
  for (std::int64_t i = 0; i < n; ++i) y[i] = 1.0F / (1.0F + nn::kernels::exp_or_nan(-x[i]));
}

void sigmoids(const double* x, std::int64_t n, double* y) {
  for (std::int64_t i = 0; i < n; ++i) y[i] = 1.0 / (1.0 + std::exp(-x[i]));
}

// Values of a corner side by side: sdf, deform, skin features, colours. Channel of a predicted row for each of the
// values of all corners, [8 · values()].
struct CornerOrder {
  explicit CornerOrder(const CornerLayout& layout) : layout(layout) {
    const std::int64_t colors = 32 + kCubeWeights, skin = colors + kCubeCorners * layout.colors;
    for (std::int64_t k = 0; k < kCubeCorners; ++k) {
      channel.push_back(k);
      for (std::int64_t i = 0; i < 3; ++i) channel.push_back(kCubeCorners + 3 * k + i);
      for (std::int64_t i = 0; i < layout.skin; ++i) channel.push_back(skin + layout.skin * k + i);
      for (std::int64_t i = 0; i < layout.colors; ++i) channel.push_back(colors + layout.colors * k + i);
    }
  }
  std::int64_t values() const { return 4 + layout.attributes(); }
  std::int64_t first_weight() const { return std::int64_t{4} * kCubeCorners; }
  std::int64_t first_color() const { return first_weight() + kCubeWeights; }

  CornerLayout layout;
  std::vector<std::int64_t> channel;
};

// Calls body(part, first, end) for parts of about kCubesPerSum, by all threads. @return the sum of its results
template <typename Body>
double sum_of_parts(std::int64_t count, const Body& body) {
  const std::int64_t parts = (count + kCubesPerSum - 1) / kCubesPerSum;
  std::vector<double> sums(static_cast<std::size_t>(parts), 0.0);
  at::parallel_for(0, parts, 1, [&](std::int64_t begin, std::int64_t end) {
    for (std::int64_t part = begin; part < end; ++part) {
      sums[static_cast<std::size_t>(part)] = body(part * kCubesPerSum, std::min(count, (part + 1) * kCubesPerSum));
    }
  });
  return std::accumulate(sums.begin(), sums.end(), 0.0);
}

// Activates the corners of cubes and puts them in order. @param values [C, 8, values()] @param weights [C, 21]
// @return Σ |·| of the regular weights
template <typename T>
double order_corners(const CornerOrder& order, const Tensor& feats, double sdf_bias, const Tensor& values,
                     const Tensor& weights) {
  const std::int64_t width = feats.size(1), count = values.size(1) * values.size(2), colors = 8 * order.layout.colors;
  const T* rows = feats.data_ptr<T>();
  T *ordered = values.data_ptr<T>(), *weight = weights.data_ptr<T>();
  return sum_of_parts(feats.size(0), [&](std::int64_t begin, std::int64_t end) {
    std::vector<T> row(static_cast<std::size_t>(width));
    double sum = 0.0;
    for (std::int64_t cube = begin; cube < end; ++cube) {
      const T* const given = rows + cube * width;
      std::copy_n(given, width, row.data());
      for (std::int64_t k = 0; k < kCubeCorners; ++k) row[static_cast<std::size_t>(k)] -= static_cast<T>(sdf_bias);
      sigmoids(given + order.first_color(), colors, row.data() + order.first_color());
      T* const to = ordered + cube * count;
      for (std::int64_t i = 0; i < count; ++i)
        to[i] = row[static_cast<std::size_t>(order.channel[static_cast<std::size_t>(i)])];
      std::copy_n(given + order.first_weight(), kCubeWeights, weight + cube * kCubeWeights);
      std::array<T, 4> some{};  // side by side
      for (std::int64_t i = 0; i < kRegularWeights; ++i)
        some[static_cast<std::size_t>(i % 4)] += std::abs(weight[cube * kCubeWeights + i]);
      sum += static_cast<double>((some[0] + some[1]) + (some[2] + some[3]));
    }
    return sum;
  });
}

// Means over the corners at each vertex, and their number. @param values [C, 8, W] @param means [V, W] @param counts
// [V]
// @return Σ (corner − mean)²
template <typename T>
double mean_of_corners(const Tensor& values, const Tensor& sources, const Tensor& means, const Tensor& counts) {
  const std::int64_t width = values.size(2);
  const T* corners = values.data_ptr<T>();
  const std::int32_t* source = sources.data_ptr<std::int32_t>();
  T *mean_of = means.data_ptr<T>(), *count_of = counts.data_ptr<T>();
  return sum_of_parts(means.size(0), [&](std::int64_t begin, std::int64_t end) {
    double sum = 0.0;
    for (std::int64_t vertex = begin; vertex < end; ++vertex) {
      // The corners of a vertex lie far apart in memory, so that they are asked for ahead of time.
      for (std::int64_t slot = (vertex + kVerticesAhead) * kCubeCorners, k = 0; k < kCubeCorners; ++k) {
        const std::int32_t entry = vertex + kVerticesAhead < end ? source[slot + k] : -1;
        if (entry < 0) continue;
        __builtin_prefetch(corners + entry * width);
        __builtin_prefetch(corners + (entry + 1) * width - 1);
      }
      std::array<const T*, kCubeCorners> corner{};
      std::size_t count = 0;
      for (std::int64_t k = 0; k < kCubeCorners; ++k) {
        const std::int64_t entry = source[vertex * kCubeCorners + k];
        if (entry >= 0) corner[count++] = corners + entry * width;
      }
      const T members = static_cast<T>(count);
      T* const mean = mean_of + vertex * width;
      count_of[vertex] = members;
      T squares = 0;
      for (std::int64_t c = 0; c < width; ++c) {
        T total = 0, own = 0;  // a sum per channel, so that additions need not wait for each other
        for (std::size_t i = 0; i < count; ++i) total += corner[i][c];
        mean[c] = total / members;
        for (std::size_t i = 0; i < count; ++i) own += (corner[i][c] - mean[c]) * (corner[i][c] - mean[c]);
        squares += own;
      }
      sum += static_cast<double>(squares);
    }
    return sum;
  });
}

struct RegularizerSlopes {
  double squares, weights;  // of Σ (corner − mean)² and of Σ |·|
};

// With the gradient g of the mean m of n corners, the corner x gets g / n + 2 s (x − m), colours times σ' = x (1 − x);
// weights w get theirs and s' sgn(w). @param d_means [V, W] g / n @param d_weights [C, 21] or undefined
// @param d_feats [C, channels] to write
template <typename T>
void corner_gradients(const CornerOrder& order, const variable_list& saved, const Tensor& d_means,
                      const Tensor& d_weights, const RegularizerSlopes& slopes, const Tensor& d_feats) {
  const Tensor &values = saved[0], &weights = saved[1], &means = saved[2], &targets = saved[3];
  const std::int64_t width = order.values(), channels = d_feats.size(1), first_color = width - order.layout.colors;
  const T *x = values.data_ptr<T>(), *weight = weights.data_ptr<T>(), *mean = means.data_ptr<T>();
  const T *slope = d_means.data_ptr<T>(), *d_weight = d_weights.defined() ? d_weights.data_ptr<T>() : nullptr;
  const std::int64_t* target = targets.data_ptr<std::int64_t>();
  T* out = d_feats.data_ptr<T>();
  const T twice = static_cast<T>(2.0 * slopes.squares), of_length = static_cast<T>(slopes.weights);
  at::parallel_for(0, values.size(0), kCubesPerSum, [&](std::int64_t begin, std::int64_t end) {
    for (std::int64_t cube = begin; cube < end; ++cube) {
      T* const row = out + cube * channels;
      for (std::int64_t k = 0; k < kCubeCorners; ++k) {
        const std::int64_t entry = cube * kCubeCorners + k, vertex = target[entry] * width;
        const T* const corner = x + entry * width;
        const std::int64_t* const channel = order.channel.data() + k * width;
        const auto slope_of = [&](std::int64_t c) {
          return slope[vertex + c] + twice * (corner[c] - mean[vertex + c]);
        };
        for (std::int64_t c = 0; c < first_color; ++c) row[channel[c]] = slope_of(c);
        for (std::int64_t c = first_color; c < width; ++c)
          row[channel[c]] = slope_of(c) * (corner[c] * (T(1) - corner[c]));
      }
      for (std::int64_t i = 0; i < kCubeWeights; ++i) {
        const T w = weight[cube * kCubeWeights + i];
        const T sign = i >= kRegularWeights ? T(0) : w > T(0) ? T(1) : w < T(0) ? T(-1) : T(0);
        row[order.first_weight() + i] =
            of_length * sign + (d_weight == nullptr ? T(0) : d_weight[cube * kCubeWeights + i]);
      }
    }
  });
}

// Sum and mean over nothing are 0.
double per_value(std::int64_t values) { return 1.0 / static_cast<double>(std::max<std::int64_t>(1, values)); }

class PredictedCorners : public torch::autograd::Function<PredictedCorners> {
 public:
  // @return sdf [V], deform [V, 3], attributes [V, A], weights [C, 21], consistency [], weights_length []
  static variable_list forward(AutogradContext* context, const Tensor& feats, const Tensor& targets,
                               const Tensor& sources, std::int64_t colors, std::int64_t skin, std::int64_t resolution) {
    RECORD_USER_SCOPE("surface extraction: corners");
    const CornerOrder order({colors, skin});
    const std::int64_t cubes = feats.size(0), vertices = sources.size(0);
    const Tensor values = torch::empty({cubes, kCubeCorners, order.values()}, feats.options());
    const Tensor weights = torch::empty({cubes, kCubeWeights}, feats.options());
    const Tensor means = torch::empty({vertices, order.values()}, feats.options());
    const Tensor counts = torch::empty({vertices, 1}, feats.options());
    double length = 0.0, squares = 0.0;
    AT_DISPATCH_FLOATING_TYPES(feats.scalar_type(), "predicted_corners", [&] {
      length = order_corners<scalar_t>(order, feats, 1.0 / static_cast<double>(resolution), values, weights);
      squares = mean_of_corners<scalar_t>(values, sources, means, counts);
    });
    context->save_for_backward({values, weights, means, targets, counts});
    context->saved_data["colors"] = colors;
    context->saved_data["skin"] = skin;
    context->set_materialize_grads(false);  // fields without a surface use some of the results
    return {means.select(1, 0).contiguous(),
            means.narrow(1, 1, 3).contiguous(),
            means.narrow(1, 4, order.layout.attributes()).contiguous(),
            weights.clone(),
            torch::full({}, squares * per_value(values.numel()), feats.options()),
            torch::full({}, length * per_value(cubes * kRegularWeights), feats.options())};
  }

  static variable_list backward(AutogradContext* context, variable_list gradients) {
    RECORD_USER_SCOPE("surface extraction: corners");
    const variable_list saved = nn::saved_once(*context, "the field of predicted corners");
    const Tensor &values = saved[0], &means = saved[2], &counts = saved[4];
    const CornerOrder order({context->saved_data["colors"].toInt(), context->saved_data["skin"].toInt()});
    const Tensor d_means = torch::zeros_like(means);
    const auto put = [&](const Tensor& gradient, std::int64_t first, std::int64_t width) {
      if (gradient.defined()) d_means.narrow(1, first, width).copy_(gradient.view({-1, width}));
    };
    put(gradients[0], 0, 1);
    put(gradients[1], 1, 3);
    put(gradients[2], 4, order.layout.attributes());
    d_means.div_(counts);
    const auto slope = [](const Tensor& gradient) { return gradient.defined() ? gradient.item<double>() : 0.0; };
    const RegularizerSlopes slopes{slope(gradients[4]) * per_value(values.numel()),
                                   slope(gradients[5]) * per_value(values.size(0) * kRegularWeights)};
    const Tensor d_weights = gradients[3].defined() ? gradients[3].contiguous() : Tensor();
    const Tensor d_feats = torch::empty({values.size(0), order.layout.channels()}, values.options());
    AT_DISPATCH_FLOATING_TYPES(values.scalar_type(), "predicted_corners_backward",
                               [&] { corner_gradients<scalar_t>(order, saved, d_means, d_weights, slopes, d_feats); });
    return {d_feats, Tensor(), Tensor(), Tensor(), Tensor(), Tensor()};
  }
};

// The grid vertices that cubes touch, and which corner meets which. @param field coords and resolution are set
RowLinks linked_field(CubeField& field) {
  const GridNumbering grid{field.resolution + 1};
  const SortedCubes cubes = sorted_cubes(field.coords, field.resolution, grid);
  TORCH_CHECK(cubes.numbers.size() < (std::size_t{1} << 28), "too many cubes");  // entries are numbered with 31 bits
  GridSet vertices = cubes.numbers;
  for (const int axis : {2, 1, 0}) vertices = with_shifted(vertices, grid.step(axis));
  field.vertices = grid_places(vertices, grid);
  return link_corners(cubes, vertices, grid);
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
  const torch::Device device = corners.sdf.device();
  CubeField field;
  field.resolution = resolution;
  field.coords = corners.coords;
  const RowLinks links = linked_field(field).to(device);
  field.vertices = field.vertices.to(device);
  const std::vector<Tensor> means = corner_means(corners, links);
  field.sdf = means[0].squeeze(-1);
  field.deform = means[1];
  field.attributes = means[2];
  field.corner_vertices = links.targets.view({-1, kCubeCorners});
  field.weights = corners.weights;
  return field;
}

Tensor corner_consistency(const CubeCorners& corners, const CubeField& field) {
  const std::int64_t values = corners.sdf.numel() + corners.deform.numel() + corners.attributes.numel();
  if (values == 0) return torch::zeros({}, corners.sdf.options());
  const Tensor vertices = field.corner_vertices.contiguous();
  const Tensor sum = squared_deviation(corners.sdf.unsqueeze(-1), field.sdf.unsqueeze(-1), vertices) +
                     squared_deviation(corners.deform, field.deform, vertices) +
                     squared_deviation(corners.attributes, field.attributes, vertices);
  return sum / static_cast<double>(values);
}

PredictedField predicted_field(const Tensor& coords, const Tensor& feats, const CornerLayout& layout,
                               std::int64_t resolution) {
  require_places(coords, resolution);
  require_shape("feats", feats, {coords.size(0), layout.channels()}, feats);
  PredictedField predicted;
  CubeField& field = predicted.field;
  field.resolution = resolution;
  field.coords = coords;
  const RowLinks links = linked_field(field);
  const variable_list found =
      PredictedCorners::apply(feats.contiguous(), links.targets, links.sources, layout.colors, layout.skin, resolution);
  field.sdf = found[0];
  field.deform = found[1];
  field.attributes = found[2];
  field.weights = found[3];
  field.corner_vertices = links.targets.view({-1, kCubeCorners});
  predicted.consistency = found[4];
  predicted.weights_length = found[5];
  return predicted;
}

}  // namespace anigen::shape_field
