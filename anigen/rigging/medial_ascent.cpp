#include "anigen/rigging/medial_ascent.h"

#include <cmath>
#include <string>

#include "anigen/core/error.h"
#include "anigen/core/parallel.h"

namespace anigen::rigging {

namespace {

using Eigen::Vector3d;

constexpr int kMostAscents = 40;
constexpr double kFirstAscent = 0.25, kLastAscent = 0.05;  // of the reach
constexpr double kDepthDifference = 0.8;                   // cells: half of what a central difference spans
// On the medial surface the depth has a ridge: central differences see both sides, and their slope falls from 1 to 0.
constexpr double kFlatRidge = 0.15;

Vector3d gradient_of_depth(const SolidField& field, const Vector3d& point) {
  const double h = kDepthDifference * field.grid.spacing;
  Vector3d gradient;
  for (int axis = 0; axis < 3; ++axis) {
    const Vector3d step = h * Vector3d::Unit(axis);
    gradient[axis] = (field.value(point - step) - field.value(point + step)) / (2.0 * h);
  }
  return gradient;
}

Vector3d ascended(const SolidField& field, const Vector3d& start, const Vector3d& along, double reach) {
  const double length = along.norm();
  const Vector3d direction = length > 0.0 ? Vector3d(along / length) : Vector3d::Zero();
  Vector3d point = start;
  double depth = -field.value(point), step = kFirstAscent * reach;
  for (int i = 0; i < kMostAscents && step >= kLastAscent * reach; ++i) {
    Vector3d uphill = gradient_of_depth(field, point);
    uphill -= uphill.dot(direction) * direction;
    const double slope = uphill.norm();
    if (!(slope > kFlatRidge)) break;
    Vector3d moved = point + step / slope * uphill - start;
    if (moved.norm() > reach) moved *= reach / moved.norm();
    const double reached = -field.value(start + moved);
    if (reached > depth) {
      point = start + moved;
      depth = reached;
    } else {
      step *= 0.5;
    }
  }
  return point;
}

}  // namespace

std::vector<Vector3d> ascend_to_medial(const SolidField& field, const std::vector<Vector3d>& points,
                                       const std::vector<Vector3d>& along, double reach) {
  if (along.size() != points.size()) {
    throw InputError("", "along",
                     std::to_string(along.size()) + " directions for " + std::to_string(points.size()) + " points");
  }
  if (!(reach >= 0.0) || !std::isfinite(reach)) throw InputError("", "reach", "must be a number of at least 0");
  std::vector<Vector3d> ascended_points(points.size());
  if (reach == 0.0) return points;
  parallel_for(points.size(), [&](std::size_t i) { ascended_points[i] = ascended(field, points[i], along[i], reach); });
  return ascended_points;
}

}  // namespace anigen::rigging
