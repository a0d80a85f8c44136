#include "anigen/geometry/uv_atlas/chart_mask.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "anigen/core/numeric.h"

namespace anigen::geometry {
namespace {

constexpr double kTexelRounding = 1e-9;  ///< a chart scaled to fill a row must not need one texel more

int texels_along(double length) { return std::max(1, static_cast<int>(std::ceil(length - kTexelRounding))); }

using RowRuns = std::vector<std::vector<ChartMask::Run>>;

/// Adds what a triangle touches: in each row, from its leftmost to its rightmost point there.
void add_triangle(const std::array<Eigen::Vector2d, 3>& corners, int width, RowRuns& rows) {
  const auto height = static_cast<int>(rows.size());
  const auto [low, high] = std::minmax({corners[0].y(), corners[1].y(), corners[2].y()});
  const int first = std::clamp(static_cast<int>(std::floor(low)), 0, height - 1);
  const int last = std::clamp(static_cast<int>(std::ceil(high)) - 1, first, height - 1);
  for (int row = first; row <= last; ++row) {
    double left = std::numeric_limits<double>::infinity(), right = -left;
    for (std::size_t k = 0; k < 3; ++k) {
      const Eigen::Vector2d &a = corners[k], &b = corners[(k + 1) % 3];
      const double rise = b.y() - a.y();
      // The part of the edge within the row, as fractions of its length.
      double from = 0.0, to = 1.0;
      if (rise != 0.0) {
        const auto [enter, leave] = std::minmax({(row - a.y()) / rise, (row + 1 - a.y()) / rise});
        from = std::max(from, enter);
        to = std::min(to, leave);
      } else if (a.y() < row || a.y() > row + 1) {
        continue;
      }
      if (from > to) continue;
      for (const double fraction : {from, to}) {
        const double x = a.x() + fraction * (b.x() - a.x());
        left = std::min(left, x);
        right = std::max(right, x);
      }
    }
    if (left > right) continue;
    const int begin = std::clamp(static_cast<int>(std::floor(left)), 0, width - 1);
    rows[at(row)].push_back({begin, std::clamp(static_cast<int>(std::ceil(right)), begin + 1, width)});
  }
}

}  // namespace

Eigen::Vector2d quarter_turned(const Eigen::Vector2d& vector, int turns) {
  switch (turns & 3) {
    case 1:
      return {-vector.y(), vector.x()};
    case 2:
      return -vector;
    case 3:
      return {vector.y(), -vector.x()};
    default:
      return vector;
  }
}

Eigen::Vector2d texel_place(const PlanarChart& flat, const Eigen::Vector2d& point, double texels_per_unit, int turns) {
  const Eigen::Vector2d corner = quarter_turned(flat.extent, turns);
  return texels_per_unit * (quarter_turned(point, turns) - corner.cwiseMin(0.0));
}

ChartMask::ChartMask(const PlanarChart& flat, double texels_per_unit, int turns) {
  const Eigen::Vector2d extent = texels_per_unit * quarter_turned(flat.extent, turns).cwiseAbs();
  width = texels_along(extent.x());
  height = texels_along(extent.y());
  std::vector<Eigen::Vector2d> places;
  for (const Eigen::Vector2d& point : flat.points) {
    places.push_back(texel_place(flat, point, texels_per_unit, turns));
  }
  RowRuns rows(at(height));
  for (const Triangle& t : flat.triangles)
    add_triangle({places[at(t[0])], places[at(t[1])], places[at(t[2])]}, width, rows);
  offsets.push_back(0);
  for (std::vector<Run>& row : rows) {
    std::sort(row.begin(), row.end(), [](const Run& a, const Run& b) { return a.begin < b.begin; });
    for (const Run& run : row) {
      if (runs.size() > offsets.back() && run.begin <= runs.back().end) {
        runs.back().end = std::max(runs.back().end, run.end);
      } else {
        runs.push_back(run);
      }
    }
    for (std::size_t i = offsets.back(); i < runs.size(); ++i) {
      if (runs[i].end - runs[i].begin <= widest) continue;
      widest = runs[i].end - runs[i].begin;
      widest_row = static_cast<int>(offsets.size()) - 1;
    }
    offsets.push_back(runs.size());
  }
}

}  // namespace anigen::geometry
