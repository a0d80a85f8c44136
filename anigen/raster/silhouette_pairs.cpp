#include "anigen/raster/silhouette_pairs.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/nn/shape_text.h"
#include "anigen/raster/check_inputs.h"
#include "anigen/raster/edge_neighbours.h"
#include "anigen/raster/share_out.h"
#include "anigen/raster/viewport.h"

namespace anigen::raster {
namespace {

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

}  // namespace

SilhouettePairs find_silhouette_pairs(const Fragments& fragments, const Tensor& clip, const Tensor& faces) {
  RECORD_USER_SCOPE("rasteriser: silhouettes");
  const torch::NoGradGuard no_grad;
  check_clip(clip);
  const Tensor corners = checked_faces(faces, clip.size(0), "faces");
  const Tensor triangle = checked_triangles(fragments.triangle, corners.size(0));
  check_real(fragments.depth, 2, "depth");
  if (fragments.depth.sizes() != triangle.sizes()) {
    throw InputError("", "depth", nn::shape_text(fragments.depth) + " for triangles of " + nn::shape_text(triangle));
  }
  const Tensor depth = fragments.depth.to(torch::kCPU, torch::kFloat64).contiguous();
  const Tensor positions = clip.to(torch::kCPU, torch::kFloat64).contiguous();
  const Viewport viewport{triangle.size(0), triangle.size(1)};
  const SilhouetteFinder finder(viewport, positions, corners, depth, triangle);
  std::vector<std::vector<FoundPair>> rows(static_cast<std::size_t>(viewport.height));
  share_out(viewport.height, [&](std::int64_t row) { rows[static_cast<std::size_t>(row)] = finder.row(row); });
  return packed(rows);
}

}  // namespace anigen::raster
