#include <ATen/Parallel.h>

#include <algorithm>
#include <vector>

#include "anigen/fields/cube_field.h"
#include "anigen/fields/grid_sets.h"

namespace anigen::fields {
namespace {

using torch::autograd::AutogradContext;
using torch::autograd::variable_list;

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
      double sum = 0.0;
      values.for_cubes(part * kCubesPerSum, std::min(cubes, (part + 1) * kCubesPerSum), [&](std::int64_t, T deviation) {
        sum += static_cast<double>(deviation) * static_cast<double>(deviation);
      });
      sums[static_cast<std::size_t>(part)] = sum;
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
    TORCH_CHECK(!at::GradMode::is_enabled(), "the corner consistency can be differentiated once only");
    const variable_list saved = context->get_saved_variables();
    const Tensor &corners = saved[0], &means = saved[1], &vertices = saved[2];
    if (!corners.is_cpu()) {
      return {2.0 * gradients[0] * deviations(corners, means, vertices), Tensor(), Tensor()};
    }
    const double scale = 2.0 * gradients[0].item<double>();
    const Tensor out = torch::empty(corners.sizes(), corners.options());
    if (corners.scalar_type() == torch::kFloat64) {
      scaled_deviations<double>(corners, means, vertices, scale, out);
    } else {
      scaled_deviations<float>(corners, means, vertices, scale, out);
    }
    return {out, Tensor(), Tensor()};
  }
};

// The kernels step through channels one by one.
Tensor adjacent(const Tensor& x) { return x.size(-1) <= 1 || x.stride(-1) == 1 ? x : x.contiguous(); }

Tensor squared_deviation(const Tensor& corners, const Tensor& means, const Tensor& vertices) {
  TORCH_CHECK(corners.dim() == 3 && corners.size(0) == vertices.size(0) && corners.size(2) == means.size(1), "corners ",
              corners.sizes(), " beside averaged values ", means.sizes());
  return CornerDeviation::apply(adjacent(corners), adjacent(means.detach()), vertices);
}

}  // namespace

Tensor corner_consistency(const CubeCorners& corners, const CubeField& field) {
  const std::int64_t values = corners.sdf.numel() + corners.deform.numel() + corners.attributes.numel();
  if (values == 0) return torch::zeros({}, corners.sdf.options());
  const Tensor vertices = field.corner_vertices.contiguous();
  const Tensor sum = squared_deviation(corners.sdf.unsqueeze(-1), field.sdf.unsqueeze(-1), vertices) +
                     squared_deviation(corners.deform, field.deform, vertices) +
                     squared_deviation(corners.attributes, field.attributes, vertices);
  return sum / static_cast<double>(values);
}

}  // namespace anigen::fields
