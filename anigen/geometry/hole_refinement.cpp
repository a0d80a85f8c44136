#include "anigen/geometry/hole_refinement.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <map>
#include <utility>

#include "anigen/core/numeric.h"

namespace anigen::geometry {
namespace {

/// How much larger than its surroundings a triangle may be (Liepa's α).
const double kDensity = std::sqrt(2.0);
constexpr int kMostRounds = 50;          ///< of adding points: each halves the size at least
constexpr std::size_t kMostTurns = 100;  ///< times the number of faces: turning edges ends by itself but for rounding

using DirectedEdge = std::array<std::int32_t, 2>;

class Refinement {
 public:
  Refinement(HolePatch& patch, std::vector<double> scale,
             const std::function<bool(std::int32_t, std::int32_t)>& may_connect)
      : patch_(patch), scale_(std::move(scale)), may_connect_(may_connect) {
    for (std::size_t f = 0; f < patch_.faces.size(); ++f) enter(f);
  }

  void run() {
    for (int round = 0; round < kMostRounds; ++round) {
      if (!add_points()) return;
      turn_edges();
    }
  }

 private:
  const Eigen::Vector3d& point(std::int32_t index) const { return patch_.points[at(index)]; }

  void enter(std::size_t face) {
    const Triangle& t = patch_.faces[face];
    for (std::size_t k = 0; k < 3; ++k) side_of_[{t[k], t[(k + 1) % 3]}] = face;
  }

  bool add_points() {
    bool added = false;
    const std::size_t count = patch_.faces.size();
    for (std::size_t f = 0; f < count; ++f) {
      const Triangle t = patch_.faces[f];
      const Eigen::Vector3d middle = (point(t[0]) + point(t[1]) + point(t[2])) / 3.0;
      const double scale = (scale_[at(t[0])] + scale_[at(t[1])] + scale_[at(t[2])]) / 3.0;
      const bool is_large = std::all_of(t.begin(), t.end(), [&](std::int32_t corner) {
        const double reach = kDensity * (point(corner) - middle).norm();
        return reach > scale && reach > scale_[at(corner)];
      });
      if (!is_large) continue;
      const auto center = static_cast<std::int32_t>(patch_.points.size());
      patch_.points.push_back(middle);
      scale_.push_back(scale);
      patch_.faces[f] = {t[0], t[1], center};
      patch_.faces.push_back({t[1], t[2], center});
      patch_.faces.push_back({t[2], t[0], center});
      for (const std::size_t changed : {f, patch_.faces.size() - 2, patch_.faces.size() - 1}) enter(changed);
      added = true;
    }
    return added;
  }

  /// Turns edges until none has opposite angles of more than 180° together.
  void turn_edges() {
    std::vector<std::size_t> waiting(patch_.faces.size());
    for (std::size_t f = 0; f < waiting.size(); ++f) waiting[f] = f;
    std::size_t turns_left = kMostTurns * patch_.faces.size();
    while (!waiting.empty() && turns_left > 0) {
      const std::size_t face = waiting.back();
      waiting.pop_back();
      for (std::size_t k = 0; k < 3; ++k) {
        const auto back = side_of_.find({patch_.faces[face][(k + 1) % 3], patch_.faces[face][k]});
        if (back == side_of_.end()) continue;
        const std::size_t other = back->second;  // turn() removes what `back` points to
        if (!turn(face, k, other)) continue;
        waiting.push_back(face);
        waiting.push_back(other);
        --turns_left;
        break;
      }
    }
  }

  static double angle(const Eigen::Vector3d& at_point, const Eigen::Vector3d& first, const Eigen::Vector3d& second) {
    const Eigen::Vector3d a = first - at_point, b = second - at_point;
    return std::atan2(a.cross(b).norm(), a.dot(b));
  }

  /// Whether the patch or the mesh around it has no edge between the two yet.
  bool is_free(std::int32_t a, std::int32_t b) const {
    if (side_of_.count({a, b}) > 0 || side_of_.count({b, a}) > 0) return false;
    return a >= patch_.outline || b >= patch_.outline || may_connect_(a, b);
  }

  /// Puts the edge from corner k of a face to the next, which it shares with `other`, between the third corners
  /// instead, if those are the larger angles. @return whether it did
  bool turn(std::size_t face, std::size_t k, std::size_t other) {
    const std::int32_t a = patch_.faces[face][k], b = patch_.faces[face][(k + 1) % 3],
                       c = patch_.faces[face][(k + 2) % 3];
    const Triangle& t = patch_.faces[other];
    const std::int32_t d = *std::find_if(t.begin(), t.end(), [&](std::int32_t v) { return v != a && v != b; });
    constexpr double kStraight = kPi + 1e-9;
    if (angle(point(c), point(a), point(b)) + angle(point(d), point(a), point(b)) <= kStraight) return false;
    if (c == d || !is_free(c, d)) return false;
    // The two angles at a (and at b) become one; more than 180° there would fold the patch.
    for (const std::int32_t end : {a, b}) {
      const std::int32_t far = end == a ? b : a;
      const double both = angle(point(end), point(c), point(far)) + angle(point(end), point(far), point(d));
      if (both >= kStraight) return false;
    }
    side_of_.erase({a, b});
    side_of_.erase({b, a});
    patch_.faces[face] = {c, a, d};
    patch_.faces[other] = {d, b, c};
    enter(face);
    enter(other);
    return true;
  }

  HolePatch& patch_;
  std::vector<double> scale_;
  const std::function<bool(std::int32_t, std::int32_t)>& may_connect_;
  std::map<DirectedEdge, std::size_t> side_of_;  ///< face that runs along an edge in this direction
};

}  // namespace

void refine_patch(HolePatch& patch, std::vector<double> scale,
                  const std::function<bool(std::int32_t, std::int32_t)>& may_connect) {
  Refinement(patch, std::move(scale), may_connect).run();
}

}  // namespace anigen::geometry
