#include "anigen/geometry/hole_triangulation.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <limits>

#include "anigen/core/numeric.h"

namespace anigen::geometry {
namespace {

constexpr double kImpossible = std::numeric_limits<double>::infinity();
/// Bends are compared in steps of this: among those that differ by rounding alone the area decides.
constexpr double kBendStep = 1e-6;

/// The sharpest bend, 0 flat to 2 folded back, and the area.
struct Weight {
  double bend = 0.0, area = 0.0;

  bool operator<(const Weight& other) const {
    return bend < other.bend - kBendStep || (bend < other.bend + kBendStep && area < other.area);
  }
};

/// The best way to close the polygon from point i to point k along the outline and straight back.
struct Span {
  Weight weight;
  std::int32_t apex = -1;  ///< of the triangle at the edge from k to i
  Eigen::Vector3d normal = Eigen::Vector3d::Zero();
};

class Triangulation {
 public:
  explicit Triangulation(const HoleOutline& hole)
      : hole_(hole),
        size_(static_cast<std::int32_t>(hole.points.size())),
        spans_(hole.points.size() * hole.points.size()) {}

  std::vector<Triangle> run() {
    for (std::int32_t i = 0; i + 1 < size_; ++i) span(i, i + 1).normal = hole_.outside[at(i)];
    for (std::int32_t length = 2; length < size_; ++length) {
      for (std::int32_t i = 0; i + length < size_; ++i) close(i, i + length);
    }
    std::vector<Triangle> triangles;
    if (span(0, size_ - 1).weight.bend == kImpossible) return triangles;
    collect(0, size_ - 1, triangles);
    return triangles;
  }

 private:
  Span& span(std::int32_t i, std::int32_t k) { return spans_[at(i) * at(size_) + at(k)]; }

  static double bend(const Eigen::Vector3d& first, const Eigen::Vector3d& second) { return 1.0 - first.dot(second); }

  void close(std::int32_t i, std::int32_t k) {
    Span& best = span(i, k);
    best.weight.bend = kImpossible;
    const bool is_whole = k - i == size_ - 1;
    if (!is_whole && !hole_.may_connect(i, k)) return;
    for (std::int32_t m = i + 1; m < k; ++m) {
      const Span &before = span(i, m), &after = span(m, k);
      if (before.weight.bend == kImpossible || after.weight.bend == kImpossible) continue;
      const Eigen::Vector3d& a = hole_.points[at(i)];
      const Eigen::Vector3d cross = (hole_.points[at(m)] - a).cross(hole_.points[at(k)] - a);
      const double twice_area = cross.norm();
      // A triangle without area has no normal: it bends by a right angle whatever it touches.
      const Eigen::Vector3d normal = twice_area > 0.0 ? Eigen::Vector3d(cross / twice_area) : Eigen::Vector3d::Zero();
      Weight weight;
      weight.bend =
          std::max({before.weight.bend, after.weight.bend, bend(normal, before.normal), bend(normal, after.normal)});
      if (is_whole) weight.bend = std::max(weight.bend, bend(normal, hole_.outside[at(k)]));
      weight.area = before.weight.area + after.weight.area + 0.5 * twice_area;
      if (best.apex < 0 || weight < best.weight) best = {weight, m, normal};
    }
  }

  void collect(std::int32_t i, std::int32_t k, std::vector<Triangle>& triangles) {
    if (k == i + 1) return;
    const std::int32_t m = span(i, k).apex;
    triangles.push_back({i, m, k});
    collect(i, m, triangles);
    collect(m, k, triangles);
  }

  const HoleOutline& hole_;
  std::int32_t size_;
  std::vector<Span> spans_;
};

}  // namespace

std::vector<Triangle> triangulate_hole(const HoleOutline& hole) { return Triangulation(hole).run(); }

}  // namespace anigen::geometry
