#include "anigen/render/visibility.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <limits>
#include <mutex>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "anigen/core/parallel.h"
#include "anigen/geometry/mesh_check.h"
#include "anigen/geometry/sampling.h"
#include "anigen/render/cameras_json.h"

namespace anigen::render {

namespace {

constexpr double kNear = 1.0, kFar = 3.0;
constexpr int kLargestMap = 16384;

/// The published cameras (docs/reference/flows.md, 5.6) measure yaw from +Y towards +X.
ViewCamera published_view(std::size_t i, std::size_t n) {
  ViewCamera view = hammersley_view(i, n, 0.0, 0.0, false);
  view.yaw = 0.5 * kPi - view.yaw;
  view.radius = kFeatureRadius;
  view.fov = kFeatureFov;
  return view;
}

std::vector<Eigen::Vector3d> middles(const Mesh& mesh) {
  std::vector<Eigen::Vector3d> points;
  points.reserve(mesh.faces.size());
  for (const auto& [a, b, c] : mesh.faces)
    points.emplace_back((mesh.vertices[at(a)] + mesh.vertices[at(b)] + mesh.vertices[at(c)]).cast<double>() / 3.0);
  return points;
}

/// A picture of face numbers. Works in the camera's homogeneous coordinates (Olano and Greer 1997): the ray of a pixel
/// is (x, y, 1), a triangle's edge is the plane through it and the eye, so nothing has to be clipped.
class FacePicture {
 public:
  FacePicture(const Mesh& mesh, int size)
      : mesh_(mesh),
        size_(size),
        half_width_(std::tan(0.5 * kFeatureFov)),
        step_(2.0 * half_width_ / size),
        pixels_(static_cast<std::size_t>(size) * static_cast<std::size_t>(size)),
        corners_(mesh.vertices.size()),
        order_(geometry::along_curve(middles(mesh))),
        seen_(mesh.faces.size(), 0) {}

  /// Calls visit(face) once for every face that shows.
  template <typename Visit>
  void draw(const ViewCamera& view, const Visit& visit) {
    const Pixel empty = background();
    std::fill(pixels_.begin(), pixels_.end(), empty);
    place_corners(view);
    for (const std::uint32_t face : order_) draw_face(static_cast<std::int32_t>(face));
    ++pictures_;
    for (const Pixel pixel : pixels_) {
      if (pixel == empty) continue;
      const std::int32_t face = kLastFace - static_cast<std::int32_t>(pixel & 0xFFFFFFFF);
      if (std::exchange(seen_[at(face)], pictures_) != pictures_) visit(face);
    }
  }

 private:
  /// 1 / depth as the bits of a float, which compare like the number, then the face counted from the end: the larger
  /// pixel is the nearer one, and what a loop without branches takes.
  using Pixel = std::int64_t;
  static constexpr Pixel kNothing = 0;

  static Pixel packed(float nearness, std::int32_t face) {
    std::int32_t bits = 0;
    std::memcpy(&bits, &nearness, sizeof bits);
    return static_cast<Pixel>(bits) * (Pixel{1} << 32) + (kLastFace - face);
  }
  static constexpr std::int32_t kLastFace = std::numeric_limits<std::int32_t>::max();
  /// No face is farther away.
  static Pixel background() { return packed(static_cast<float>(1.0 / kFar), kLastFace); }

  /// In the camera's frame (x right, y up, z depth), and where that is in the picture.
  struct Corner {
    Eigen::Vector3d point;
    double column, row;
  };
  struct Bounds {
    int first_column, last_column, first_row, last_row;
  };

  double coordinate(int pixel) const { return (pixel + 0.5) * step_ - half_width_; }

  void place_corners(const ViewCamera& view) {
    const Eigen::Matrix4d camera = camera_to_world(view);
    Eigen::Matrix3d axes = camera.topLeftCorner<3, 3>().transpose();
    axes.row(2) = -axes.row(2).eval();  // the camera looks along its -Z
    const Eigen::Vector3d eye = camera.topRightCorner<3, 1>();
    for (std::size_t v = 0; v < corners_.size(); ++v) {
      Corner& corner = corners_[v];
      corner.point = axes * (mesh_.vertices[v].cast<double>() - eye);
      corner.column = (corner.point.x() / corner.point.z() + half_width_) / step_ - 0.5;
      corner.row = (corner.point.y() / corner.point.z() + half_width_) / step_ - 0.5;
    }
  }

  /// Pixels whose centres the face may cover; none when it is behind the eye.
  Bounds bounds_of(const std::array<const Corner*, 3>& corners) const {
    const auto [nearest, farthest] = std::minmax({corners[0]->point.z(), corners[1]->point.z(), corners[2]->point.z()});
    if (farthest <= 0.0) return {0, -1, 0, -1};
    if (nearest <= 1e-6 * farthest) return {0, size_ - 1, 0, size_ - 1};
    const auto [left, right] = std::minmax({corners[0]->column, corners[1]->column, corners[2]->column});
    const auto [low, high] = std::minmax({corners[0]->row, corners[1]->row, corners[2]->row});
    // A little wider than rounding, so that no pixel is lost that the planes would give to the face.
    constexpr double kSlack = 1e-6;
    const auto first = [&](double from) {
      return static_cast<int>(std::ceil(std::clamp(from - kSlack, 0.0, size_ + 0.0)));
    };
    const auto last = [&](double to) {
      return static_cast<int>(std::floor(std::clamp(to + kSlack, -1.0, size_ - 1.0)));
    };
    return {first(left), last(right), first(low), last(high)};
  }

  /// The plane through the eye and an edge. Both faces at the edge get the same numbers but for the sign, so that a
  /// pixel on it belongs to one of them at least.
  static Eigen::Vector3d edge_plane(std::int32_t from, std::int32_t to, const Eigen::Vector3d& a,
                                    const Eigen::Vector3d& b) {
    return from < to ? Eigen::Vector3d(a.cross(b)) : Eigen::Vector3d(-b.cross(a));
  }

  void draw_face(std::int32_t index) {
    const Triangle& face = mesh_.faces[at(index)];
    const std::array<const Corner*, 3> corners{&corners_[at(face[0])], &corners_[at(face[1])], &corners_[at(face[2])]};
    const Bounds bounds = bounds_of(corners);
    if (bounds.first_column > bounds.last_column || bounds.first_row > bounds.last_row) return;
    std::array<Eigen::Vector3d, 3> planes;
    for (std::size_t k = 0; k < 3; ++k) {
      const std::size_t next = (k + 1) % 3;
      planes[k] = edge_plane(face[k], face[next], corners[k]->point, corners[next]->point);
    }
    const double volume = corners[2]->point.dot(planes[0]);
    if (volume == 0.0 || !std::isfinite(volume)) return;  // seen from its edge
    if (volume < 0.0) {
      for (Eigen::Vector3d& plane : planes) plane = -plane;
    }
    // 1 / depth along the ray (x, y, 1) is the sum of the three planes there, over the volume.
    const Eigen::Vector3d nearness = (planes[0] + planes[1] + planes[2]) / std::abs(volume);
    for (int row = bounds.first_row; row <= bounds.last_row; ++row) {
      const double y = coordinate(row);
      int first = bounds.first_column, last = bounds.last_column;
      for (const Eigen::Vector3d& plane : planes) narrow(plane.x(), plane.y() * y + plane.z(), first, last);
      draw_span(index, row, first, last, nearness.x(), nearness.y() * y + nearness.z());
    }
  }

  /// Leaves of the columns from first to last those with slope · x + rest ≥ 0. The division finds the end but for
  /// rounding, the form itself decides, since it has the same value but for the sign for the face beyond the edge.
  void narrow(double slope, double rest, int& first, int& last) const {
    const auto is_inside = [&](int column) { return slope * coordinate(column) + rest >= 0.0; };
    if (slope == 0.0) {
      if (rest < 0.0) last = first - 1;
      return;
    }
    const double end = (-rest / slope + half_width_) / step_ - 0.5;
    if (slope > 0.0) {
      int column = static_cast<int>(std::ceil(std::clamp(end, first - 1.0, last + 1.0)));
      while (column > first && is_inside(column - 1)) --column;
      while (column <= last && !is_inside(column)) ++column;
      first = std::max(first, column);
    } else {
      int column = static_cast<int>(std::floor(std::clamp(end, first - 1.0, last + 1.0)));
      while (column < last && is_inside(column + 1)) ++column;
      while (column >= first && !is_inside(column)) --column;
      last = std::min(last, column);
    }
  }

  void draw_span(std::int32_t face, int row, int first, int last, double slope, double rest) {
    Pixel* pixels = pixels_.data() + static_cast<std::size_t>(row) * static_cast<std::size_t>(size_);
    for (int column = first; column <= last; ++column) {
      const auto nearness = static_cast<float>(slope * coordinate(column) + rest);
      const Pixel pixel = nearness <= static_cast<float>(1.0 / kNear) ? packed(nearness, face) : kNothing;
      pixels[column] = std::max(pixels[column], pixel);
    }
  }

  const Mesh& mesh_;
  int size_;
  double half_width_, step_;
  std::vector<Pixel> pixels_;
  std::vector<Corner> corners_;
  std::vector<std::uint32_t> order_;  ///< of drawing: faces near each other share cache lines of the picture
  std::vector<std::uint32_t> seen_;   ///< number of the last picture in which a face was seen
  std::uint32_t pictures_ = 0;
};

}  // namespace

std::vector<float> face_visibility(const Mesh& mesh, const VisibilityViews& options) {
  if (options.views == 0) throw InputError("", "views", "there must be at least one view");
  require_between(options.size, 1, kLargestMap, "size");
  geometry::check_mesh(mesh.vertices, mesh.faces);
  std::vector<std::atomic<std::uint32_t>> counts(mesh.faces.size());
  std::mutex reporting;
  std::atomic<std::size_t> next{0};
  std::size_t done = 0;
  // One picture per thread: its buffers are large.
  const std::size_t workers = std::min(options.views, static_cast<std::size_t>(thread_count()));
  parallel_for(workers, [&](std::size_t) {
    FacePicture picture(mesh, options.size);
    for (std::size_t view = next++; view < options.views; view = next++) {
      picture.draw(published_view(view, options.views),
                   [&](std::int32_t face) { counts[at(face)].fetch_add(1, std::memory_order_relaxed); });
      const std::lock_guard<std::mutex> lock(reporting);
      ++done;
      if (options.progress) options.progress(done);
    }
  });
  std::vector<float> shares(counts.size());
  for (std::size_t f = 0; f < shares.size(); ++f)
    shares[f] = static_cast<float>(counts[f].load()) / static_cast<float>(options.views);
  return shares;
}

VisibleMesh remove_hidden_faces(const Mesh& mesh, const HiddenFaceRemoval& options) {
  const std::vector<float> visibility = face_visibility(mesh, options.views);
  VisibleMesh result;
  if (std::find(visibility.begin(), visibility.end(), 0.0f) == visibility.end()) {
    result.mesh = mesh;
    return result;
  }
  geometry::FaceMarks kept = geometry::hidden_faces(mesh.vertices, mesh.faces, visibility, options.rules);
  for (char& mark : kept) mark = mark == 0;
  const Mesh visible = geometry::chosen_faces(mesh.vertices, mesh.faces, kept);
  result.removed = mesh.faces.size() - visible.faces.size();
  geometry::FilledMesh filled = geometry::fill_holes(visible.vertices, visible.faces, options.holes);
  result.filled_holes = filled.filled;
  result.open_holes = filled.left_open + filled.broken;
  result.mesh = std::move(filled.mesh);
  return result;
}

}  // namespace anigen::render
