#include "anigen/raster/antialias.h"

#include <ATen/Dispatch.h>
#include <ATen/Parallel.h>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>

#include "anigen/core/error.h"
#include "anigen/nn/init.h"
#include "anigen/raster/mesh_renderer.h"

namespace anigen::raster {

namespace {

constexpr std::int64_t kVerticesAtOnce = 4096;

constexpr double kSlack = 1.0 / 16.0;  // pixels that a crossing may lie beyond a centre
constexpr std::int64_t kVertexGrain = 4096;

struct FoundPair {
  std::int64_t first, below, a, b;
  double weight;
};

// Positions in pixels from the centre of the picture; NaN behind the camera, which no comparison lets through.
std::vector<std::array<double, 2>> in_pixels(const Viewport& viewport, const double* clip, std::int64_t vertices) {
  std::vector<std::array<double, 2>> positions(static_cast<std::size_t>(vertices));
  at::parallel_for(0, vertices, kVertexGrain, [&](std::int64_t begin, std::int64_t end) {
    for (std::int64_t v = begin; v < end; ++v) {
      const double* p = clip + 4 * v;
      const double scale = p[3] > 0.0 ? 1.0 / p[3] : std::numeric_limits<double>::quiet_NaN();
      positions[static_cast<std::size_t>(v)] = {p[0] * scale * viewport.half_width(),
                                                p[1] * scale * viewport.half_height()};
    }
  });
  return positions;
}

class SilhouetteFinder {
 public:
  SilhouetteFinder(const Viewport& viewport, const Tensor& clip, const Tensor& faces, const Tensor& depth,
                   const Tensor& triangle)
      : viewport_(viewport),
        clip_(clip.data_ptr<double>()),
        faces_(faces.data_ptr<std::int64_t>()),
        depth_(depth.data_ptr<double>()),
        triangle_(triangle.data_ptr<std::int64_t>()),
        positions_(in_pixels(viewport, clip_, clip.size(0))),
        neighbours_(faces_, faces.size(0), clip.size(0)) {}

  std::vector<FoundPair> row(std::int64_t row) const {
    std::vector<FoundPair> found;
    const std::int64_t begin = row * viewport_.width;
    for (std::int64_t pixel = begin; pixel + 1 < begin + viewport_.width; ++pixel) {
      if (const auto pair = examine(pixel, pixel + 1, false)) found.push_back(*pair);
    }
    if (row + 1 == viewport_.height) return found;
    for (std::int64_t pixel = begin; pixel < begin + viewport_.width; ++pixel) {
      if (const auto pair = examine(pixel, pixel + viewport_.width, true)) found.push_back(*pair);
    }
    return found;
  }

 private:
  std::optional<FoundPair> examine(std::int64_t first, std::int64_t second, bool below) const {
    if (triangle_[first] == triangle_[second]) return std::nullopt;
    const bool owner_first = triangle_[second] == 0 || (triangle_[first] != 0 && depth_[first] < depth_[second]);
    const std::int64_t owner = owner_first ? first : second, face = triangle_[owner] - 1;
    const double toward = owner_first ? 1.0 : -1.0;
    // Along the pair, and across it.
    const std::size_t along = below ? 1 : 0, across = below ? 0 : 1;
    const std::array<double, 2> centre{static_cast<double>(owner % viewport_.width) + 0.5 - viewport_.half_width(),
                                       static_cast<double>(owner / viewport_.width) + 0.5 - viewport_.half_height()};
    double farthest = -kSlack;  // an edge behind the centre can neither win nor, by winning, prevent another
    FoundPair pair{first, below ? 1 : 0, -1, -1, 0.0};
    for (std::int64_t k = 0; k < 3; ++k) {
      const std::int64_t a = faces_[3 * face + (k + 1) % 3], b = faces_[3 * face + (k + 2) % 3];
      const auto &pa = positions_[static_cast<std::size_t>(a)], &pb = positions_[static_cast<std::size_t>(b)];
      const double height_a = pa[across] - centre[across], height_b = pb[across] - centre[across];
      if ((height_a < 0.0) == (height_b < 0.0)) continue;
      const double rise = height_b - height_a, run = pb[along] - pa[along];
      if (!(std::abs(rise) >= std::abs(run))) continue;
      const double distance = toward * (pa[along] - centre[along] - height_a * run / rise);
      if (!(distance > farthest) || !is_silhouette(a, b, faces_[3 * face + k], face)) continue;
      farthest = distance;
      pair.a = a;
      pair.b = b;
    }
    if (pair.a < 0 || farthest >= 1.0 + kSlack) return std::nullopt;
    pair.weight = toward * (0.5 - std::min(std::max(farthest, 0.0), 1.0));
    return pair;
  }

  // Sides are told by the determinant of the edge's ends and the corner as (x, y, w), without dividing by w: it also
  // says, for a corner behind the camera, on which side the triangle begins.
  bool is_silhouette(std::int64_t a, std::int64_t b, std::int64_t corner, std::int64_t face) const {
    const double *p = clip_ + 4 * a, *q = clip_ + 4 * b;
    const double line[3] = {p[1] * q[3] - p[3] * q[1], p[3] * q[0] - p[0] * q[3], p[0] * q[1] - p[1] * q[0]};
    const auto side = [&](std::int64_t vertex) {
      const double* r = clip_ + 4 * vertex;
      return line[0] * r[0] + line[1] * r[1] + line[2] * r[3];
    };
    const double own = side(corner);
    bool continues = false;
    neighbours_.visit_others(a, b, face, [&](std::int64_t other) {
      const double there = side(other);
      if (there != 0.0 && (there < 0.0) != (own < 0.0)) continues = true;
    });
    return !continues;
  }

  Viewport viewport_;
  const double* clip_;
  const std::int64_t* faces_;
  const double* depth_;
  const std::int64_t* triangle_;
  std::vector<std::array<double, 2>> positions_;
  EdgeNeighbours neighbours_;
};

SilhouettePairs packed(const std::vector<std::vector<FoundPair>>& rows) {
  std::int64_t count = 0;
  for (const auto& row : rows) count += static_cast<std::int64_t>(row.size());
  SilhouettePairs pairs{torch::empty({count, 4}, torch::kInt64), torch::empty({count}, torch::kFloat64),
                        torch::zeros({static_cast<std::int64_t>(rows.size()) + 1}, torch::kInt64)};
  std::int64_t* index = pairs.index.data_ptr<std::int64_t>();
  double* weight = pairs.weight.data_ptr<double>();
  std::int64_t* row_begin = pairs.row_begin.data_ptr<std::int64_t>();
  for (const auto& row : rows) {
    for (const FoundPair& pair : row) {
      for (const std::int64_t value : {pair.first, pair.below, pair.a, pair.b}) *index++ = value;
      *weight++ = pair.weight;
    }
    row_begin[1] = row_begin[0] + static_cast<std::int64_t>(row.size());
    ++row_begin;
  }
  return pairs;
}

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
    AT_DISPATCH_FLOATING_TYPES(image.scalar_type(), "antialiasing", [&] {
      blend_rows(pairs, image.size(0), image.size(2), from.data_ptr<scalar_t>(), out.data_ptr<scalar_t>());
    });
    context->save_for_backward({image, clip, index, weight, row_begin});
    return out;
  }

  static variable_list backward(AutogradContext* context, variable_list gradients) {
    RECORD_USER_SCOPE("rasteriser: antialiasing");
    const torch::autograd::variable_list saved = nn::saved_once(*context, "antialiasing");
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

EdgeNeighbours::EdgeNeighbours(const std::int64_t* faces, std::int64_t face_count, std::int64_t vertex_count)
    : begin_(static_cast<std::size_t>(vertex_count) + 1, 0), sides_(static_cast<std::size_t>(3 * face_count)) {
  const auto lower_of = [&](std::int64_t face, std::int64_t k) {
    return static_cast<std::size_t>(std::min(faces[3 * face + (k + 1) % 3], faces[3 * face + (k + 2) % 3]));
  };
  // Counting sort by the lower vertex: begin_[v + 1] counts, then becomes where v's sides begin, then where they end.
  for (std::int64_t face = 0; face < face_count; ++face) {
    for (std::int64_t k = 0; k < 3; ++k) ++begin_[lower_of(face, k) + 1];
  }
  std::size_t sum = 0;
  for (std::size_t v = 1; v < begin_.size(); ++v) {
    const std::size_t count = begin_[v];
    begin_[v] = sum;
    sum += count;
  }
  for (std::int64_t face = 0; face < face_count; ++face) {
    for (std::int64_t k = 0; k < 3; ++k) {
      const std::int64_t upper = std::max(faces[3 * face + (k + 1) % 3], faces[3 * face + (k + 2) % 3]);
      sides_[begin_[lower_of(face, k) + 1]++] = {static_cast<std::int32_t>(upper),
                                                 static_cast<std::int32_t>(faces[3 * face + k]),
                                                 static_cast<std::int32_t>(face)};
    }
  }
  share_out((vertex_count + kVerticesAtOnce - 1) / kVerticesAtOnce, [&](std::int64_t part) {
    const std::int64_t end = std::min(vertex_count, (part + 1) * kVerticesAtOnce);
    for (std::int64_t v = part * kVerticesAtOnce; v < end; ++v) {
      const auto lower = static_cast<std::size_t>(v);
      if (!is_sorted(lower)) continue;
      const auto from = sides_.begin() + static_cast<std::ptrdiff_t>(begin_[lower]);
      const auto to = sides_.begin() + static_cast<std::ptrdiff_t>(begin_[lower + 1]);
      std::sort(from, to,
                [](const Side& a, const Side& b) { return a.upper != b.upper ? a.upper < b.upper : a.face < b.face; });
    }
  });
}

std::size_t EdgeNeighbours::first_side(std::size_t lower, std::int64_t upper) const {
  if (!is_sorted(lower)) return begin_[lower];
  const auto from = sides_.begin() + static_cast<std::ptrdiff_t>(begin_[lower]);
  const auto to = sides_.begin() + static_cast<std::ptrdiff_t>(begin_[lower + 1]);
  const auto found = std::lower_bound(
      from, to, upper, [](const Side& side, std::int64_t value) { return std::int64_t{side.upper} < value; });
  return static_cast<std::size_t>(found - sides_.begin());
}

SilhouettePairs find_silhouette_pairs(const Fragments& fragments, const Tensor& clip, const Tensor& faces) {
  RECORD_USER_SCOPE("rasteriser: silhouettes");
  const torch::NoGradGuard no_grad;
  check_clip(clip);
  const Tensor corners = checked_faces(faces, clip.size(0), "faces");
  const Tensor triangle = checked_triangles(fragments.triangle, corners.size(0));
  check_real(fragments.depth, 2, "depth");
  if (fragments.depth.sizes() != triangle.sizes())
    throw InputError("", "depth", nn::shape_text(fragments.depth) + " for triangles of " + nn::shape_text(triangle));
  const Tensor depth = fragments.depth.to(torch::kCPU, torch::kFloat64).contiguous();
  const Tensor positions = clip.to(torch::kCPU, torch::kFloat64).contiguous();
  const Viewport viewport{triangle.size(0), triangle.size(1)};
  const SilhouetteFinder finder(viewport, positions, corners, depth, triangle);
  std::vector<std::vector<FoundPair>> rows(static_cast<std::size_t>(viewport.height));
  share_out(viewport.height, [&](std::int64_t row) { rows[static_cast<std::size_t>(row)] = finder.row(row); });
  return packed(rows);
}

Tensor antialias(const Tensor& image, const Fragments& fragments, const Tensor& clip, const Tensor& faces) {
  check_real(image, 3, "image");
  const SilhouettePairs pairs = find_silhouette_pairs(fragments, clip, faces);
  if (image.size(0) != fragments.triangle.size(0) || image.size(1) != fragments.triangle.size(1))
    throw InputError("", "image", nn::shape_text(image) + " for triangles of " + nn::shape_text(fragments.triangle));
  return Antialiasing::apply(image.to(torch::kCPU), clip.to(torch::kCPU), pairs.index, pairs.weight, pairs.row_begin)
      .to(image.device());
}

}  // namespace anigen::raster
