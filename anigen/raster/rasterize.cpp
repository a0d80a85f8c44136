#include "anigen/raster/rasterize.h"

#include <limits>
#include <string>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/raster/interpolate.h"
#include "anigen/raster/mesh_renderer.h"

namespace anigen::raster {

namespace {

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

// sign · p[axis] + scale · w ≥ offset
struct CutPlane {
  std::size_t axis;
  double sign, scale, offset;

  double distance(const ClipPoint& p) const { return sign * p[axis] + scale * p[3] - offset; }
  void put_onto(ClipPoint& p) const { p[axis] = sign * (offset - scale * p[3]); }
};

// Intersection of an edge with the plane. From the end nearer to the plane, so that a far end of huge coordinates does
// not drown the result; and the same bits whichever end comes first.
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

// True when all corners have w > 0, |z| ≤ w, |x| ≤ guard_x w and |y| ≤ guard_y w.
bool inside_view(const std::array<ClipPoint, 3>& triangle, double guard_x, double guard_y) {
  return std::all_of(triangle.begin(), triangle.end(), [&](const ClipPoint& p) {
    const double w = p[3];
    return w > 0.0 && std::abs(p[2]) <= w && std::abs(p[0]) <= guard_x * w && std::abs(p[1]) <= guard_y * w;
  });
}

// The part of a triangle of which inside_view() holds; fewer than three points when there is none. Triangles that share
// an edge are cut at the same points of it, so no gap opens between them (Sutherland and Hodgman 1974, "Reentrant
// polygon clipping").
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

constexpr double kGuardPixels = 32768.0;  // farther out, triangles are cut, so that positions fit in 32 bits

/// A triangle ready to be drawn: where it covers pixel centres, and its depth there. A triangle that had to be clipped
/// becomes several of these, all with the plane of the whole.
struct ScreenTriangle {
  std::array<std::int32_t, 3> x, y;                             ///< corners in steps of 1/2^subpixel_bits pixel
  std::int32_t first_column, last_column, first_row, last_row;  ///< of the pixel centres that it may cover
  std::int32_t face;
  double depth_at_origin, depth_per_column, depth_per_row;  ///< z/w as a plane over pixels, from unsnapped corners
  double nearest, farthest;                                 ///< z/w of the visible corners bounds it
};

// True when all corners lie beyond the same face of the view volume.
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

// Appends what there is to draw of one face; nothing when it lies outside the picture, covers no pixel centre or has no
// area. Corners turn so that the area is positive (x right, y down). @param clip [V, 4] @param corners its three
// vertices
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
    for (std::int64_t f = g * kGroupFaces; f < end; ++f)
      append_screen_triangles(viewport, clip, faces + 3 * f, static_cast<std::int32_t>(f), group.triangles);
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

// The nearest triangle at every pixel centre, and of several equally near ones the first. Edges that two triangles
// share are covered by exactly one of them: positions are integers, and a centre on an edge belongs to the triangle
// whose left or top edge it is. Runs on all threads, each drawing some rows; the same result for any number.
// @param clip [V, 4], finite @param faces [F, 3], valid
// @param depth [H, W] z/w; infinity where there is nothing @param triangle [H, W] index + 1; 0 where there is nothing
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

using torch::autograd::AutogradContext;
using torch::autograd::variable_list;

constexpr std::int64_t kGrainPixels = 4096;

void check_viewport(const Viewport& viewport) {
  if (viewport.height < 1 || viewport.width < 1 || viewport.height > kMostPixelsPerSide ||
      viewport.width > kMostPixelsPerSide) {
    throw InputError("", "size",
                     "a picture of " + std::to_string(viewport.height) + " x " + std::to_string(viewport.width) +
                         " pixels; each side must have 1 to " + std::to_string(kMostPixelsPerSide));
  }
  if (viewport.subpixel_bits < 1 || viewport.subpixel_bits > kMostSubpixelBits) {
    throw InputError("", "subpixel_bits",
                     std::to_string(viewport.subpixel_bits) + " is not in 1 … " + std::to_string(kMostSubpixelBits));
  }
}

void check_finite(const Tensor& clip) {
  const double* values = clip.data_ptr<double>();
  for (std::int64_t i = 0; i < clip.numel(); ++i) {
    if (!std::isfinite(values[i])) throw InputError("", "vertex " + std::to_string(i / 4), "is not finite");
  }
}

// Barycentrics of what is visible, and depth 0 for the background.
void resolve(const Viewport& viewport, const double* clip, const std::int64_t* faces, const std::int64_t* triangle,
             double* barycentric, double* depth) {
  at::parallel_for(0, viewport.height * viewport.width, kGrainPixels, [&](std::int64_t begin, std::int64_t end) {
    for (std::int64_t pixel = begin; pixel < end; ++pixel) {
      if (triangle[pixel] == 0) {
        depth[pixel] = barycentric[2 * pixel] = barycentric[2 * pixel + 1] = 0.0;
        continue;
      }
      const PixelTriangle seen(clip, faces + 3 * (triangle[pixel] - 1), viewport.x(pixel % viewport.width),
                               viewport.y(pixel / viewport.width));
      const auto [u, v] = seen.barycentric();
      barycentric[2 * pixel] = u;
      barycentric[2 * pixel + 1] = v;
    }
  });
}

// Outputs: barycentric, depth, triangle.
class Rasterization : public torch::autograd::Function<Rasterization> {
 public:
  static variable_list forward(AutogradContext* context, const Tensor& clip, const Tensor& faces, std::int64_t height,
                               std::int64_t width, std::int64_t subpixel_bits) {
    RECORD_USER_SCOPE("rasteriser: rasterisation");
    const Viewport viewport{height, width, subpixel_bits};
    const Tensor positions = clip.to(torch::kFloat64).contiguous();
    check_finite(positions);
    const Tensor depth = torch::empty({height, width}, torch::kFloat64);
    const Tensor barycentric = torch::empty({height, width, 2}, torch::kFloat64);
    const Tensor triangle = torch::empty({height, width}, torch::kInt64);
    const double* points = positions.data_ptr<double>();
    const std::int64_t* corners = faces.data_ptr<std::int64_t>();
    find_visible(viewport, points, corners, faces.size(0), depth.data_ptr<double>(), triangle.data_ptr<std::int64_t>());
    resolve(viewport, points, corners, triangle.data_ptr<std::int64_t>(), barycentric.data_ptr<double>(),
            depth.data_ptr<double>());
    const Tensor depth_out = depth.to(nn::dtype_of(clip));
    context->save_for_backward({clip, faces, triangle});
    context->mark_non_differentiable({depth_out, triangle});
    return {barycentric.to(nn::dtype_of(clip)), depth_out, triangle};
  }

  static variable_list backward(AutogradContext* context, variable_list gradients) {
    RECORD_USER_SCOPE("rasteriser: rasterisation");
    const torch::autograd::variable_list saved = nn::saved_once(*context, "rasterisation");
    const Tensor &clip = saved[0], &faces = saved[1], &triangle = saved[2];
    const Viewport viewport{triangle.size(0), triangle.size(1)};
    const Tensor positions = clip.to(torch::kFloat64).contiguous();
    const Tensor slopes = gradients[0].to(torch::kFloat64).contiguous();
    const Tensor sums = torch::zeros({clip.size(0), 4}, torch::kFloat64);
    const double *points = positions.data_ptr<double>(), *slope = slopes.data_ptr<double>();
    const std::int64_t *corners = faces.data_ptr<std::int64_t>(), *id = triangle.data_ptr<std::int64_t>();
    double* sum = sums.data_ptr<double>();
    const auto corners_of = [&](std::int64_t pixel) -> const std::int64_t* {
      const bool none = id[pixel] == 0 || (slope[2 * pixel] == 0.0 && slope[2 * pixel + 1] == 0.0);
      return none ? nullptr : corners + 3 * (id[pixel] - 1);
    };
    const auto add = [&](std::int64_t pixel, const std::int64_t* vertices, const VertexShare& share) {
      const double x = viewport.x(pixel % viewport.width), y = viewport.y(pixel / viewport.width);
      const auto moved = PixelTriangle(points, vertices, x, y).gradients(x, y, slope[2 * pixel], slope[2 * pixel + 1]);
      for (std::size_t k = 0; k < 3; ++k) {
        if (!share.owns(vertices[k])) continue;
        double* to = sum + 4 * vertices[k];
        to[0] += moved[k][0];
        to[1] += moved[k][1];
        to[3] += moved[k][2];
      }
    };
    sum_by_vertex(triangle.numel(), corners_of, add);
    return {sums.to(nn::dtype_of(clip)), Tensor(), Tensor(), Tensor(), Tensor()};
  }
};

}  // namespace

Fragments rasterize(const Tensor& clip, const Tensor& faces, std::int64_t height, std::int64_t width,
                    std::int64_t subpixel_bits) {
  check_clip(clip);
  check_viewport({height, width, subpixel_bits});
  const Tensor corners = checked_faces(faces, clip.size(0), "faces");
  const variable_list seen = Rasterization::apply(clip.to(torch::kCPU), corners, height, width, subpixel_bits);
  return {seen[0].to(clip.device()), seen[1].to(clip.device()), seen[2].to(clip.device())};
}

}  // namespace anigen::raster
