#include "anigen/prepare/creatures/field.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace anigen::prepare {

using Eigen::Vector3d;

Field::Field(std::vector<Primitive> primitives) : primitives_(std::move(primitives)) {}

double Field::value(const Vector3d& x, const PrimitiveList& list) const {
  double result = 1e300;
  for (int i : list) {
    const Primitive& p = primitives_[i];
    const double d = signed_distance(p, x);
    if (p.carve) {
      const double gap = p.blend - std::abs(result + d);
      result = std::max(result, -d);
      if (gap > 0.0) result += gap * gap / (4.0 * p.blend);
      continue;
    }
    const double gap = p.blend - std::abs(result - d);
    result = std::min(result, d);
    if (gap > 0.0) result -= gap * gap / (4.0 * p.blend);
  }
  return result;
}

Vector3d Field::gradient(const Vector3d& x, const PrimitiveList& list, double step) const {
  // The four corners of a tetrahedron: the fewest points that give all three derivatives to second order.
  static const Vector3d kCorners[4] = {{1, 1, 1}, {1, -1, -1}, {-1, 1, -1}, {-1, -1, 1}};
  Vector3d sum = Vector3d::Zero();
  for (const Vector3d& corner : kCorners) sum += corner * value(x + step * corner, list);
  return sum / (4.0 * step);
}

void Field::narrow(const Vector3d& x, const PrimitiveList& list, double reach, PrimitiveList& result) const {
  thread_local std::vector<double> distances;
  distances.clear();
  double nearest = 1e300, blend = 0.0;
  for (int i : list) {
    distances.push_back(signed_distance(primitives_[i], x));
    if (!primitives_[i].carve) nearest = std::min(nearest, distances.back());
  }
  for (std::size_t n = 0; n < list.size(); ++n) {
    if (distances[n] < nearest + 2.0 * reach + primitives_[list[n]].blend) {
      blend = std::max(blend, primitives_[list[n]].blend);
    }
  }
  result.clear();
  for (std::size_t n = 0; n < list.size(); ++n) {
    const double from = primitives_[list[n]].carve ? 0.0 : nearest;
    if (distances[n] < from + 2.0 * reach + blend) result.push_back(list[n]);
  }
}

Field::Content Field::classify(const Vector3d& center, double radius, const PrimitiveList& candidates,
                               PrimitiveList& list) const {
  list.clear();
  thread_local std::vector<double> bounds;
  bounds.resize(candidates.size());
  double blend = 0.0;
  bool near_surface = false, covered = false, carved = false;
  for (std::size_t i = 0; i < candidates.size(); ++i) {
    const Primitive& p = primitives_[candidates[i]];
    bounds[i] = distance_bound(p, center);
    if (bounds[i] < radius + p.blend) {
      blend = std::max(blend, p.blend);
      near_surface = true;
      (p.carve ? carved : covered) |= p.carve || bounds[i] < -radius;
    }
  }
  if (!near_surface) return Content::kOutside;
  if (covered && !carved) return Content::kInside;
  for (std::size_t i = 0; i < candidates.size(); ++i) {
    if (bounds[i] < radius + blend) list.push_back(candidates[i]);
  }
  return Content::kMixed;
}

}  // namespace anigen::prepare
