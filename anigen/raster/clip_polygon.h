#pragma once
#include <array>
#include <cstddef>

namespace anigen::raster {

using ClipPoint = std::array<double, 4>;  ///< x, y, z, w

/// A convex polygon in clip space; room for what cutting a triangle with seven planes can leave.
struct ClipPolygon {
  static constexpr std::size_t kMostPoints = 16;
  std::array<ClipPoint, kMostPoints> points{};
  std::size_t size = 0;

  void add(const ClipPoint& point) {
    if (size < kMostPoints) points[size++] = point;
  }
};

/// Whether all corners have w > 0, |z| ≤ w, |x| ≤ guard_x w and |y| ≤ guard_y w.
bool inside_view(const std::array<ClipPoint, 3>& triangle, double guard_x, double guard_y);

/// The part of a triangle of which inside_view() holds; fewer than three points when there is none. Triangles that
/// share an edge are cut at the same points of it, so no gap opens between them.
/// (Sutherland and Hodgman 1974, "Reentrant polygon clipping".)
ClipPolygon clip_to_view(const std::array<ClipPoint, 3>& triangle, double guard_x, double guard_y);

}  // namespace anigen::raster
