#pragma once
#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <utility>

namespace anigen::geometry {

/// Calls visit(x, y) for every texel of [0, width) × [0, height) whose centre (x + ½, y + ½) lies in the triangle,
/// whichever way it runs. Triangles that share an edge, with the same numbers at both ends, share no centre and leave
/// none out: each row is cut at edges computed from their lower to their upper end, and takes what is at or right of
/// the first cut and left of the second.
template <typename Visit>
void for_each_texel_centre(const Eigen::Vector2d& a, const Eigen::Vector2d& b, const Eigen::Vector2d& c, int width,
                           int height, Visit&& visit) {
  const Eigen::Vector2d* corners[4] = {&a, &b, &c, &a};
  const double low = std::min({a.y(), b.y(), c.y()}), high = std::max({a.y(), b.y(), c.y()});
  const auto first_centre = [](double value, int limit) {  // the first i ≥ 0 with i + ½ ≥ value
    return static_cast<int>(std::clamp(std::ceil(value - 0.5), 0.0, static_cast<double>(limit)));
  };
  const int end = first_centre(high, height);
  for (int y = first_centre(low, height); y < end; ++y) {
    const double centre = y + 0.5;
    double cuts[2] = {0.0, 0.0};
    int count = 0;
    for (int k = 0; k < 3; ++k) {
      const Eigen::Vector2d *from = corners[k], *to = corners[k + 1];
      if (from->y() > to->y()) std::swap(from, to);
      if (!(from->y() <= centre && centre < to->y()) || count == 2) continue;
      cuts[count++] = from->x() + (to->x() - from->x()) * ((centre - from->y()) / (to->y() - from->y()));
    }
    if (count < 2) continue;
    const int last = first_centre(std::max(cuts[0], cuts[1]), width);
    for (int x = first_centre(std::min(cuts[0], cuts[1]), width); x < last; ++x) visit(x, y);
  }
}

}  // namespace anigen::geometry
