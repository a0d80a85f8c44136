#include "anigen/raster/screen_triangle.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "anigen/raster/clip_polygon.h"

namespace anigen::raster {
namespace {

constexpr double kGuardPixels = 32768.0;  // farther out, triangles are cut, so that positions fit in 32 bits

// Whether all corners lie beyond the same face of the view volume.
bool outside_view(const std::array<ClipPoint, 3>& p) {
  for (std::size_t axis = 0; axis < 3; ++axis) {
    if (p[0][axis] > p[0][3] && p[1][axis] > p[1][3] && p[2][axis] > p[2][3]) return true;
    if (p[0][axis] < -p[0][3] && p[1][axis] < -p[1][3] && p[2][axis] < -p[2][3]) return true;
  }
  return false;
}

// Rounded to the nearest step. Truncation rounds down what is positive, and is one instruction.
std::int32_t snapped(double position, double half_size, std::int64_t bits) {
  const double pixels = std::clamp((position + 1.0) * half_size, -kGuardPixels, kGuardPixels) + kGuardPixels;
  const std::int64_t steps = std::int64_t{1} << bits;
  const auto from_guard = static_cast<std::int64_t>(pixels * static_cast<double>(steps) + 0.5);
  return static_cast<std::int32_t>(from_guard - static_cast<std::int64_t>(kGuardPixels) * steps);
}

// The plane of z/w. With n_k = p_i × p_j of the other two corners as (x, y, w), the weight of corner k at (X, Y) is
// n_k · (X, Y, 1), and Σ weight_k w_k is the determinant of the three everywhere, so z/w = Σ z_k n_k · (X, Y, 1) / det.
void set_depth_plane(const Viewport& viewport, const std::array<ClipPoint, 3>& p, ScreenTriangle& triangle) {
  double normal[3] = {0.0, 0.0, 0.0}, determinant = 0.0;
  for (std::size_t k = 0; k < 3; ++k) {
    const ClipPoint &a = p[(k + 1) % 3], &b = p[(k + 2) % 3];
    const double n[3] = {a[1] * b[3] - a[3] * b[1], a[3] * b[0] - a[0] * b[3], a[0] * b[1] - a[1] * b[0]};
    for (std::size_t i = 0; i < 3; ++i) normal[i] += p[k][2] * n[i];
    if (k == 0) determinant = n[0] * p[0][0] + n[1] * p[0][1] + n[2] * p[0][3];
  }
  triangle.depth_per_column = normal[0] / determinant / viewport.half_width();
  triangle.depth_per_row = normal[1] / determinant / viewport.half_height();
  triangle.depth_at_origin = (normal[0] * viewport.x(0) + normal[1] * viewport.y(0) + normal[2]) / determinant;
  if (!std::isfinite(triangle.depth_per_column) || !std::isfinite(triangle.depth_per_row) ||
      !std::isfinite(triangle.depth_at_origin)) {
    // Seen edge on. Snapping may still give it pixels, and without them there would be gaps beside it.
    triangle.depth_per_column = triangle.depth_per_row = 0.0;
    triangle.depth_at_origin = triangle.farthest;
  }
}

// The pixels whose centres, at (i + 1/2) 2^bits, lie between two positions. Shifts round down also below zero.
std::pair<std::int64_t, std::int64_t> pixels_between(std::int64_t least, std::int64_t most, std::int64_t bits,
                                                     std::int64_t pixels) {
  const std::int64_t half = std::int64_t{1} << (bits - 1), step = std::int64_t{1} << bits;
  const std::int64_t first = (least - half + step - 1) >> bits, last = (most - half) >> bits;
  return {std::max<std::int64_t>(first, 0), std::min(last, pixels - 1)};
}

// Fills in x, y and the pixels. @return whether there is anything to draw
bool place(const Viewport& viewport, const std::array<std::int32_t, 3>& x, const std::array<std::int32_t, 3>& y,
           ScreenTriangle& triangle) {
  const std::int64_t x1 = std::int64_t{x[1]} - x[0], y1 = std::int64_t{y[1]} - y[0];
  const std::int64_t x2 = std::int64_t{x[2]} - x[0], y2 = std::int64_t{y[2]} - y[0];
  const std::int64_t area = x1 * y2 - y1 * x2;
  if (area == 0) return false;
  const auto [left, right] = std::minmax({x[0], x[1], x[2]});
  const auto [top, bottom] = std::minmax({y[0], y[1], y[2]});
  const auto columns = pixels_between(left, right, viewport.subpixel_bits, viewport.width);
  const auto rows = pixels_between(top, bottom, viewport.subpixel_bits, viewport.height);
  if (columns.first > columns.second || rows.first > rows.second) return false;
  triangle.x = x;
  triangle.y = y;
  if (area < 0) {
    std::swap(triangle.x[1], triangle.x[2]);
    std::swap(triangle.y[1], triangle.y[2]);
  }
  triangle.first_column = static_cast<std::int32_t>(columns.first);
  triangle.last_column = static_cast<std::int32_t>(columns.second);
  triangle.first_row = static_cast<std::int32_t>(rows.first);
  triangle.last_row = static_cast<std::int32_t>(rows.second);
  return true;
}

// @param points of the visible part of the triangle, in order around it
void append_fan(const Viewport& viewport, const std::array<ClipPoint, 3>& whole, const ClipPoint* points,
                std::size_t size, std::int32_t face, std::vector<ScreenTriangle>& triangles) {
  std::array<std::int32_t, ClipPolygon::kMostPoints> x{}, y{};
  ScreenTriangle triangle{};
  triangle.face = face;
  triangle.nearest = 1.0;
  triangle.farthest = -1.0;
  for (std::size_t i = 0; i < size; ++i) {
    const ClipPoint& p = points[i];
    const double inverse_w = 1.0 / p[3];
    x[i] = snapped(p[0] * inverse_w, viewport.half_width(), viewport.subpixel_bits);
    y[i] = snapped(p[1] * inverse_w, viewport.half_height(), viewport.subpixel_bits);
    const double depth = std::clamp(p[2] * inverse_w, -1.0, 1.0);
    triangle.nearest = std::min(triangle.nearest, depth);
    triangle.farthest = std::max(triangle.farthest, depth);
  }
  bool has_plane = false;
  for (std::size_t i = 1; i + 1 < size; ++i) {
    if (!place(viewport, {x[0], x[i], x[i + 1]}, {y[0], y[i], y[i + 1]}, triangle)) continue;
    if (!has_plane) set_depth_plane(viewport, whole, triangle);  // late: most small triangles cover no pixel centre
    has_plane = true;
    triangles.push_back(triangle);
  }
}

}  // namespace

void append_screen_triangles(const Viewport& viewport, const double* clip, const std::int64_t* corners,
                             std::int32_t face, std::vector<ScreenTriangle>& triangles) {
  std::array<ClipPoint, 3> whole;
  for (std::size_t k = 0; k < 3; ++k) std::copy_n(clip + 4 * corners[k], 4, whole[k].begin());
  if (outside_view(whole)) return;
  // (x/w + 1) · width/2 stays within ± kGuardPixels.
  const double guard_x = kGuardPixels / viewport.half_width() - 1.0;
  const double guard_y = kGuardPixels / viewport.half_height() - 1.0;
  if (inside_view(whole, guard_x, guard_y)) {
    append_fan(viewport, whole, whole.data(), whole.size(), face, triangles);
    return;
  }
  const ClipPolygon polygon = clip_to_view(whole, guard_x, guard_y);
  append_fan(viewport, whole, polygon.points.data(), polygon.size, face, triangles);
}

}  // namespace anigen::raster
