#include "anigen/raster/antialias.h"

#include <ATen/Parallel.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/nn/shape_text.h"
#include "anigen/raster/check_inputs.h"
#include "anigen/raster/silhouette_pairs.h"
#include "anigen/raster/viewport.h"

namespace anigen::raster {
namespace {

using torch::autograd::AutogradContext;
using torch::autograd::variable_list;

constexpr std::int64_t kGrainPairs = 256;
constexpr double kLeastRise = 1e-3;  // pixels, added to the height of an edge when dividing by it in the backward pass

// SilhouettePairs as plain pointers, for a picture of `width` pixels in a row.
struct PairTable {
  PairTable(const Tensor& index, const Tensor& weights, const Tensor& row_begins, std::int64_t picture_width)
      : entry(index.data_ptr<std::int64_t>()),
        weight(weights.data_ptr<double>()),
        row_begin(row_begins.data_ptr<std::int64_t>()),
        count(index.size(0)),
        width(picture_width) {}

  std::int64_t first(std::int64_t pair) const { return entry[4 * pair]; }
  bool below(std::int64_t pair) const { return entry[4 * pair + 1] != 0; }
  std::int64_t second(std::int64_t pair) const { return first(pair) + (below(pair) ? width : 1); }
  std::int64_t vertex(std::int64_t pair, std::int64_t end) const { return entry[4 * pair + 2 + end]; }
  std::int64_t changed(std::int64_t pair) const { return weight[pair] > 0.0 ? first(pair) : second(pair); }

  // The pairs that may touch a row's pixels: its own and those of the row before.
  std::int64_t begin_for(std::int64_t row) const { return row_begin[std::max<std::int64_t>(row - 1, 0)]; }
  std::int64_t end_for(std::int64_t row) const { return row_begin[row + 1]; }

  const std::int64_t* entry;
  const double* weight;
  const std::int64_t* row_begin;
  std::int64_t count, width;
};

// Each row collects what changes it, so that rows can be worked on in any order.
template <typename T>
void blend_rows(const PairTable& pairs, std::int64_t height, std::int64_t channels, const T* image, T* out) {
  at::parallel_for(0, height, 1, [&](std::int64_t begin, std::int64_t end) {
    for (std::int64_t row = begin; row < end; ++row) {
      std::copy_n(image + row * pairs.width * channels, pairs.width * channels, out + row * pairs.width * channels);
      for (std::int64_t pair = pairs.begin_for(row); pair < pairs.end_for(row); ++pair) {
        const std::int64_t changed = pairs.changed(pair);
        if (changed / pairs.width != row) continue;
        const T *first = image + channels * pairs.first(pair), *second = image + channels * pairs.second(pair);
        const T weight = static_cast<T>(pairs.weight[pair]);
        for (std::int64_t c = 0; c < channels; ++c) out[channels * changed + c] += weight * (second[c] - first[c]);
      }
    }
  });
}

// @param gradient of the result @param out gradient of the image
template <typename T>
void blend_rows_backward(const PairTable& pairs, std::int64_t height, std::int64_t channels, const T* gradient,
                         T* out) {
  at::parallel_for(0, height, 1, [&](std::int64_t begin, std::int64_t end) {
    for (std::int64_t row = begin; row < end; ++row) {
      std::copy_n(gradient + row * pairs.width * channels, pairs.width * channels, out + row * pairs.width * channels);
      for (std::int64_t pair = pairs.begin_for(row); pair < pairs.end_for(row); ++pair) {
        const std::int64_t first = pairs.first(pair), second = pairs.second(pair);
        const T* from = gradient + channels * pairs.changed(pair);
        const T weight = static_cast<T>(pairs.weight[pair]);
        if (first / pairs.width == row) {
          for (std::int64_t c = 0; c < channels; ++c) out[channels * first + c] -= weight * from[c];
        }
        if (second / pairs.width == row) {
          for (std::int64_t c = 0; c < channels; ++c) out[channels * second + c] += weight * from[c];
        }
      }
    }
  });
}

// d loss / d weight of every pair; 0 for saturated ones, whose edge can move without effect.
template <typename T>
std::vector<double> weight_slopes(const PairTable& pairs, std::int64_t channels, const T* image, const T* gradient) {
  std::vector<double> slopes(static_cast<std::size_t>(pairs.count), 0.0);
  at::parallel_for(0, pairs.count, kGrainPairs, [&](std::int64_t begin, std::int64_t end) {
    for (std::int64_t pair = begin; pair < end; ++pair) {
      if (std::abs(pairs.weight[pair]) >= 0.5) continue;
      const T *first = image + channels * pairs.first(pair), *second = image + channels * pairs.second(pair);
      const T* from = gradient + channels * pairs.changed(pair);
      double sum = 0.0;
      for (std::int64_t c = 0; c < channels; ++c) sum += static_cast<double>(from[c] * (second[c] - first[c]));
      slopes[static_cast<std::size_t>(pair)] = sum;
    }
  });
  return slopes;
}

// The weight is ± (0.5 − distance) with the distance counted towards the other pixel, so its derivative by the
// crossing's position along the pair is −1 whichever pixel owns the edge. @param out [V, 4], added to
void add_vertex_gradients(const PairTable& pairs, const std::vector<double>& slopes, const Viewport& viewport,
                          const double* clip, double* out) {
  const std::array<double, 2> half{viewport.half_width(), viewport.half_height()};
  for (std::int64_t pair = 0; pair < pairs.count; ++pair) {
    const double slope = -slopes[static_cast<std::size_t>(pair)];
    if (slope == 0.0) continue;
    const std::size_t along = pairs.below(pair) ? 1 : 0, across = 1 - along;
    const std::int64_t cell = pairs.below(pair) ? pairs.first(pair) % pairs.width : pairs.first(pair) / pairs.width;
    const double line = static_cast<double>(cell) + 0.5 - half[across];  // through both centres
    std::array<std::array<double, 2>, 2> ends{};                         // of the edge, in pixels
    for (std::size_t end = 0; end < 2; ++end) {
      const double* p = clip + 4 * pairs.vertex(pair, static_cast<std::int64_t>(end));
      for (std::size_t axis = 0; axis < 2; ++axis) ends[end][axis] = p[axis] / p[3] * half[axis];
    }
    const double exact_rise = ends[1][across] - ends[0][across];
    const double rise = exact_rise + std::copysign(kLeastRise, exact_rise);
    const double share = (line - ends[0][across]) / rise, lean = (ends[1][along] - ends[0][along]) / rise;
    for (std::size_t end = 0; end < 2; ++end) {
      const std::int64_t vertex = pairs.vertex(pair, static_cast<std::int64_t>(end));
      const double w = clip[4 * vertex + 3], weight = slope * (end == 0 ? 1.0 - share : share);
      std::array<double, 2> moved{};  // gradient by the end's position in pixels
      moved[along] = weight;
      moved[across] = -weight * lean;
      double* to = out + 4 * vertex;
      to[0] += moved[0] * half[0] / w;
      to[1] += moved[1] * half[1] / w;
      to[3] -= (moved[0] * ends[end][0] + moved[1] * ends[end][1]) / w;
    }
  }
}

class Antialiasing : public torch::autograd::Function<Antialiasing> {
 public:
  static Tensor forward(AutogradContext* context, const Tensor& image, const Tensor& clip, const Tensor& index,
                        const Tensor& weight, const Tensor& row_begin) {
    RECORD_USER_SCOPE("rasteriser: antialiasing");
    const Tensor from = image.contiguous(), out = torch::empty_like(from);
    const PairTable pairs(index, weight, row_begin, image.size(1));
    if (nn::dtype_of(image) == torch::kFloat64) {
      blend_rows(pairs, image.size(0), image.size(2), from.data_ptr<double>(), out.data_ptr<double>());
    } else {
      blend_rows(pairs, image.size(0), image.size(2), from.data_ptr<float>(), out.data_ptr<float>());
    }
    context->save_for_backward({image, clip, index, weight, row_begin});
    return out;
  }

  static variable_list backward(AutogradContext* context, variable_list gradients) {
    RECORD_USER_SCOPE("rasteriser: antialiasing");
    TORCH_CHECK(!at::GradMode::is_enabled(), "antialiasing can be differentiated once only");
    const variable_list saved = context->get_saved_variables();
    const bool is_double = nn::dtype_of(saved[0]) == torch::kFloat64;
    return is_double ? backward_in<double>(saved, gradients[0].contiguous())
                     : backward_in<float>(saved, gradients[0].contiguous());
  }

 private:
  template <typename T>
  static variable_list backward_in(const variable_list& saved, const Tensor& gradient) {
    const Tensor image = saved[0].contiguous(), positions = saved[1].to(torch::kFloat64).contiguous();
    const std::int64_t height = image.size(0), width = image.size(1), channels = image.size(2);
    const PairTable pairs(saved[2], saved[3], saved[4], width);
    const Tensor to_image = torch::empty_like(image), to_clip = torch::zeros_like(positions);
    blend_rows_backward(pairs, height, channels, gradient.data_ptr<T>(), to_image.data_ptr<T>());
    const std::vector<double> slopes = weight_slopes(pairs, channels, image.data_ptr<T>(), gradient.data_ptr<T>());
    add_vertex_gradients(pairs, slopes, Viewport{height, width}, positions.data_ptr<double>(),
                         to_clip.data_ptr<double>());
    return {to_image, to_clip.to(nn::dtype_of(saved[1])), Tensor(), Tensor(), Tensor()};
  }
};

}  // namespace

Tensor antialias(const Tensor& image, const Fragments& fragments, const Tensor& clip, const Tensor& faces) {
  check_real(image, 3, "image");
  const SilhouettePairs pairs = find_silhouette_pairs(fragments, clip, faces);
  if (image.size(0) != fragments.triangle.size(0) || image.size(1) != fragments.triangle.size(1)) {
    throw InputError("", "image", nn::shape_text(image) + " for triangles of " + nn::shape_text(fragments.triangle));
  }
  return Antialiasing::apply(image.to(torch::kCPU), clip.to(torch::kCPU), pairs.index, pairs.weight, pairs.row_begin)
      .to(image.device());
}

}  // namespace anigen::raster
