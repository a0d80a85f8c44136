#include "anigen/geometry/uv_atlas/planar_chart.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <limits>
#include <utility>

#include "anigen/core/numeric.h"

namespace anigen::geometry {
namespace {

double planar_cross(const Eigen::Vector2d& a, const Eigen::Vector2d& b) { return a.x() * b.y() - a.y() * b.x(); }

/// Corners in counter-clockwise order (Andrew's monotone chain); fewer than three when all points are on a line.
std::vector<Eigen::Vector2d> convex_hull(std::vector<Eigen::Vector2d> points) {
  const auto before = [](const Eigen::Vector2d& a, const Eigen::Vector2d& b) {
    return a.x() != b.x() ? a.x() < b.x() : a.y() < b.y();
  };
  std::sort(points.begin(), points.end(), before);
  std::vector<Eigen::Vector2d> hull;
  for (int side = 0; side < 2; ++side) {
    const std::size_t first = hull.size();
    for (const Eigen::Vector2d& point : points) {
      while (hull.size() >= first + 2 &&
             planar_cross(hull.back() - hull[hull.size() - 2], point - hull.back()) <= 0.0) {
        hull.pop_back();
      }
      hull.push_back(point);
    }
    hull.pop_back();  // starts the other side
    std::reverse(points.begin(), points.end());
  }
  return hull;
}

/// Direction of the longer side of the smallest rectangle around the points; it shares a side with their hull.
Eigen::Vector2d longer_side(const std::vector<Eigen::Vector2d>& points) {
  const std::vector<Eigen::Vector2d> hull = convex_hull(points);
  Eigen::Vector2d best = Eigen::Vector2d::UnitX();
  double smallest = std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < hull.size(); ++i) {
    const Eigen::Vector2d side = hull[(i + 1) % hull.size()] - hull[i];
    if (side.isZero(0.0)) continue;
    const Eigen::Vector2d along = side.normalized(), across(-along.y(), along.x());
    Eigen::Vector2d low = Eigen::Vector2d::Constant(std::numeric_limits<double>::infinity()), high = -low;
    for (const Eigen::Vector2d& corner : hull) {
      const Eigen::Vector2d turned(along.dot(corner), across.dot(corner));
      low = low.cwiseMin(turned);
      high = high.cwiseMax(turned);
    }
    const Eigen::Vector2d extent = high - low;
    if (extent.prod() >= smallest) continue;
    smallest = extent.prod();
    best = extent.x() >= extent.y() ? along : across;
  }
  return best;
}

}  // namespace

PlanarChart planar_chart(SurfaceChart chart, const std::vector<Eigen::Vector3f>& vertices,
                         const std::vector<Triangle>& faces) {
  PlanarChart flat;
  flat.chart = std::move(chart);
  for (const std::int32_t face : flat.chart.faces) {
    flat.vertices.insert(flat.vertices.end(), faces[at(face)].begin(), faces[at(face)].end());
  }
  std::sort(flat.vertices.begin(), flat.vertices.end());
  flat.vertices.erase(std::unique(flat.vertices.begin(), flat.vertices.end()), flat.vertices.end());
  flat.right = flat.chart.axis.unitOrthogonal();
  flat.up = flat.chart.axis.cross(flat.right);
  for (const std::int32_t vertex : flat.vertices) {
    const Eigen::Vector3d p = vertices[at(vertex)].cast<double>();
    flat.points.emplace_back(flat.right.dot(p), flat.up.dot(p));
  }

  const Eigen::Vector2d along = longer_side(flat.points);
  const Eigen::Vector3d right = along.x() * flat.right + along.y() * flat.up;
  flat.up = along.x() * flat.up - along.y() * flat.right;
  flat.right = right;
  Eigen::Vector2d low = Eigen::Vector2d::Constant(std::numeric_limits<double>::infinity()), high = -low;
  for (Eigen::Vector2d& point : flat.points) {
    point = Eigen::Vector2d(along.dot(point), planar_cross(along, point));
    low = low.cwiseMin(point);
    high = high.cwiseMax(point);
  }
  for (Eigen::Vector2d& point : flat.points) point -= low;
  flat.extent = high - low;

  for (const std::int32_t face : flat.chart.faces) {
    Triangle triangle;
    for (std::size_t k = 0; k < 3; ++k) {
      const auto found = std::lower_bound(flat.vertices.begin(), flat.vertices.end(), faces[at(face)][k]);
      triangle[k] = static_cast<std::int32_t>(found - flat.vertices.begin());
    }
    flat.triangles.push_back(triangle);
    const Eigen::Vector2d& a = flat.points[at(triangle[0])];
    flat.area += 0.5 * planar_cross(flat.points[at(triangle[1])] - a, flat.points[at(triangle[2])] - a);
  }
  return flat;
}

}  // namespace anigen::geometry
