#include "anigen/raster/visibility.h"

#include <algorithm>
#include <array>
#include <limits>
#include <utility>
#include <vector>

#include "anigen/raster/screen_triangle.h"
#include "anigen/raster/share_out.h"

namespace anigen::raster {
namespace {

constexpr std::int64_t kGroupFaces = 512;  // set up together, and skipped together by bands they do not reach
constexpr std::int64_t kBandRows = 8;      // drawn together
constexpr std::int64_t kFewColumns = 6;    // tried one by one; more are cheaper to solve for

// Faces in order, as far as they show.
struct TriangleGroup {
  std::vector<ScreenTriangle> triangles;
  std::int32_t first_row = std::numeric_limits<std::int32_t>::max(), last_row = -1;
};

std::int64_t floor_quotient(std::int64_t a, std::int64_t positive) { return a / positive - (a % positive < 0 ? 1 : 0); }

// Inside where at_row − dy · x ≥ 0, with x the position of the pixel centre.
struct EdgeInRow {
  std::int64_t at_row, dy;
};

// The three edges of a triangle: dx (y − y_a) − dy (x − x_a) is positive inside, and 0 counts on left and top edges.
class EdgeFunctions {
 public:
  EdgeFunctions(const ScreenTriangle& triangle, std::int64_t bits)
      : step_(std::int64_t{1} << bits), half_(std::int64_t{1} << (bits - 1)) {
    for (std::size_t k = 0; k < 3; ++k) {
      const std::size_t next = (k + 1) % 3;
      dx_[k] = std::int64_t{triangle.x[next]} - triangle.x[k];
      dy_[k] = std::int64_t{triangle.y[next]} - triangle.y[k];
      const bool left_or_top = dy_[k] < 0 || (dy_[k] == 0 && dx_[k] > 0);
      offset_[k] = dy_[k] * triangle.x[k] - dx_[k] * triangle.y[k] - (left_or_top ? 0 : 1);
    }
  }

  /// The columns of a row that are inside, among [first, end); they are adjacent.
  std::pair<std::int64_t, std::int64_t> columns(std::int64_t row, std::int64_t first, std::int64_t end) const {
    std::array<EdgeInRow, 3> edges;
    for (std::size_t k = 0; k < 3; ++k) edges[k] = {dx_[k] * centre(row) + offset_[k], dy_[k]};
    if (end - first > kFewColumns) return solve(edges, first, end);
    while (first < end && !inside(edges, first)) ++first;
    while (first < end && !inside(edges, end - 1)) --end;
    return {first, end};
  }

 private:
  std::int64_t centre(std::int64_t pixel) const { return pixel * step_ + half_; }

  bool inside(const std::array<EdgeInRow, 3>& edges, std::int64_t column) const {
    const std::int64_t x = centre(column);
    return edges[0].at_row >= edges[0].dy * x && edges[1].at_row >= edges[1].dy * x &&
           edges[2].at_row >= edges[2].dy * x;
  }

  std::pair<std::int64_t, std::int64_t> solve(const std::array<EdgeInRow, 3>& edges, std::int64_t first,
                                              std::int64_t end) const {
    for (const EdgeInRow& edge : edges) {
      if (edge.dy > 0) {  // x ≤ at_row / dy
        end = std::min(end, floor_quotient(edge.at_row - edge.dy * half_, edge.dy * step_) + 1);
      } else if (edge.dy < 0) {  // x ≥ at_row / dy
        first = std::max(first, -floor_quotient(edge.at_row - edge.dy * half_, -edge.dy * step_));
      } else if (edge.at_row < 0) {
        end = first;
      }
    }
    return {first, std::max(first, end)};
  }

  std::int64_t step_, half_;
  std::array<std::int64_t, 3> dx_{}, dy_{}, offset_{};
};

std::vector<TriangleGroup> set_up(const Viewport& viewport, const double* clip, const std::int64_t* faces,
                                  std::int64_t face_count) {
  std::vector<TriangleGroup> groups(static_cast<std::size_t>((face_count + kGroupFaces - 1) / kGroupFaces));
  share_out(static_cast<std::int64_t>(groups.size()), [&](std::int64_t g) {
    TriangleGroup& group = groups[static_cast<std::size_t>(g)];
    const std::int64_t end = std::min(face_count, (g + 1) * kGroupFaces);
    for (std::int64_t f = g * kGroupFaces; f < end; ++f) {
      append_screen_triangles(viewport, clip, faces + 3 * f, static_cast<std::int32_t>(f), group.triangles);
    }
    for (const ScreenTriangle& triangle : group.triangles) {
      group.first_row = std::min(group.first_row, triangle.first_row);
      group.last_row = std::max(group.last_row, triangle.last_row);
    }
  });
  return groups;
}

// The rows first … end − 1 of one triangle. @param depth, triangles of the whole picture
void draw(const Viewport& viewport, const ScreenTriangle& triangle, std::int64_t first, std::int64_t end, double* depth,
          std::int64_t* triangles) {
  const EdgeFunctions edges(triangle, viewport.subpixel_bits);
  first = std::max<std::int64_t>(first, triangle.first_row);
  end = std::min<std::int64_t>(end, triangle.last_row + 1);
  for (std::int64_t row = first; row < end; ++row) {
    const auto [begin, stop] = edges.columns(row, triangle.first_column, triangle.last_column + 1);
    const double in_row = triangle.depth_at_origin + triangle.depth_per_row * static_cast<double>(row);
    double* depth_row = depth + row * viewport.width;
    std::int64_t* triangle_row = triangles + row * viewport.width;
    for (std::int64_t column = begin; column < stop; ++column) {
      const double here = std::clamp(in_row + triangle.depth_per_column * static_cast<double>(column), triangle.nearest,
                                     triangle.farthest);
      if (here < depth_row[column]) {
        depth_row[column] = here;
        triangle_row[column] = std::int64_t{triangle.face} + 1;
      }
    }
  }
}

}  // namespace

void find_visible(const Viewport& viewport, const double* clip, const std::int64_t* faces, std::int64_t face_count,
                  double* depth, std::int64_t* triangle) {
  const std::vector<TriangleGroup> groups = set_up(viewport, clip, faces, face_count);
  share_out((viewport.height + kBandRows - 1) / kBandRows, [&](std::int64_t band) {
    const std::int64_t first = band * kBandRows, end = std::min(viewport.height, first + kBandRows);
    const std::int64_t begin = first * viewport.width, pixels = (end - first) * viewport.width;
    std::fill_n(depth + begin, pixels, std::numeric_limits<double>::infinity());
    std::fill_n(triangle + begin, pixels, std::int64_t{0});
    for (const TriangleGroup& group : groups) {
      if (group.first_row >= end || group.last_row < first) continue;
      for (const ScreenTriangle& drawn : group.triangles) {
        if (drawn.first_row < end && drawn.last_row >= first) draw(viewport, drawn, first, end, depth, triangle);
      }
    }
  });
}

}  // namespace anigen::raster
