#include "anigen/raster/clip_polygon.h"

#include <algorithm>
#include <cmath>

namespace anigen::raster {
namespace {

// sign · p[axis] + scale · w ≥ offset
struct CutPlane {
  std::size_t axis;
  double sign, scale, offset;

  double distance(const ClipPoint& p) const { return sign * p[axis] + scale * p[3] - offset; }
  void put_onto(ClipPoint& p) const { p[axis] = sign * (offset - scale * p[3]); }
};

// Where an edge meets the plane. From the end nearer to the plane, so that a far end of huge coordinates does not drown
// the result; and the same bits whichever end comes first.
ClipPoint crossing(const CutPlane& plane, const ClipPoint& a, double distance_a, const ClipPoint& b,
                   double distance_b) {
  if (std::abs(distance_a) > std::abs(distance_b)) return crossing(plane, b, distance_b, a, distance_a);
  ClipPoint point;
  if (std::abs(distance_a) == std::abs(distance_b)) {
    for (std::size_t k = 0; k < 4; ++k) point[k] = 0.5 * (a[k] + b[k]);
  } else {
    const double share = distance_a / (distance_a - distance_b);
    for (std::size_t k = 0; k < 4; ++k) point[k] = a[k] + share * (b[k] - a[k]);
  }
  plane.put_onto(point);
  return point;
}

ClipPolygon cut(const ClipPolygon& polygon, const CutPlane& plane) {
  ClipPolygon kept;
  for (std::size_t i = 0; i < polygon.size; ++i) {
    const ClipPoint &a = polygon.points[i], &b = polygon.points[(i + 1) % polygon.size];
    const double distance_a = plane.distance(a), distance_b = plane.distance(b);
    if (distance_a >= 0.0) kept.add(a);
    if ((distance_a >= 0.0) != (distance_b >= 0.0)) kept.add(crossing(plane, a, distance_a, b, distance_b));
  }
  return kept;
}

}  // namespace

bool inside_view(const std::array<ClipPoint, 3>& triangle, double guard_x, double guard_y) {
  return std::all_of(triangle.begin(), triangle.end(), [&](const ClipPoint& p) {
    const double w = p[3];
    return w > 0.0 && std::abs(p[2]) <= w && std::abs(p[0]) <= guard_x * w && std::abs(p[1]) <= guard_y * w;
  });
}

ClipPolygon clip_to_view(const std::array<ClipPoint, 3>& triangle, double guard_x, double guard_y) {
  // The other planes meet in w = 0, through which nothing can be projected: a little of it is cut off first.
  double largest_w = 0.0;
  for (const ClipPoint& p : triangle) largest_w = std::max(largest_w, p[3]);
  const double least_w = 1e-12 * largest_w;
  const CutPlane planes[] = {{3, 1.0, 0.0, least_w}, {2, 1.0, 1.0, 0.0},      {2, -1.0, 1.0, 0.0},
                             {0, 1.0, guard_x, 0.0}, {0, -1.0, guard_x, 0.0}, {1, 1.0, guard_y, 0.0},
                             {1, -1.0, guard_y, 0.0}};
  ClipPolygon polygon;
  if (!(largest_w > 0.0)) return polygon;
  for (const ClipPoint& p : triangle) polygon.add(p);
  for (const CutPlane& plane : planes) polygon = cut(polygon, plane);
  return polygon;
}

}  // namespace anigen::raster
