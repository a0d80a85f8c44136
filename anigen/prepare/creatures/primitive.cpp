#include "anigen/prepare/creatures/primitive.h"

#include <algorithm>
#include <cmath>

#include "anigen/core/numeric.h"

namespace anigen::prepare {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

// The union of spheres along the axis: minimise |x - a - s u| - r(s) over s in [0, length]. With y the coordinate along
// the axis, q the distance from it and k the slope of the radius, the free minimum is at s = y + q k / sqrt(1 - k²).
double cone_distance(const Primitive& p, const Vector3d& x) {
  const Vector3d from = x - p.a;
  if (p.length <= 0.0) return from.norm() - std::max(p.ra, p.rb);
  const double y = from.dot(p.unit);
  const double q2 = std::max(from.squaredNorm() - y * y, 0.0);
  const double s = std::clamp(y + std::sqrt(q2) * p.lean, 0.0, p.length);
  return std::sqrt(q2 + (y - s) * (y - s)) - (p.ra + (p.rb - p.ra) * (s / p.length));
}

double ellipsoid_distance(const Primitive& p, const Vector3d& x) {
  const Vector3d local = p.axes.transpose() * (x - p.a);
  const Vector3d scaled = local.cwiseQuotient(p.half);
  const double value = scaled.norm();
  const double slope = scaled.cwiseQuotient(p.half).norm();
  if (slope < 1e-9) return -p.half.minCoeff();
  return value * (value - 1.0) / slope;
}

double box_distance(const Vector3d& local, const Vector3d& half) {
  const Vector3d d = local.cwiseAbs() - half;
  return d.cwiseMax(0.0).norm() + std::min(d.maxCoeff(), 0.0);
}

double segment_distance(const Vector2d& p, const Vector2d& a, const Vector2d& b) {
  const Vector2d ab = b - a;
  const double t = std::clamp((p - a).dot(ab) / std::max(ab.squaredNorm(), 1e-24), 0.0, 1.0);
  return (p - a - t * ab).norm();
}

// A trapezoid in the half plane (distance from the axis, height).
double cylinder_distance(const Primitive& p, const Vector3d& x) {
  const double rounding = p.half.x();
  const double length = p.length;
  const Vector3d from = x - p.a;
  const double y = from.dot(p.unit);
  const Vector2d at(std::sqrt(std::max(from.squaredNorm() - y * y, 0.0)), y);
  const double r0 = p.ra - rounding, r1 = p.rb - rounding, y0 = rounding, y1 = length - rounding;
  const Vector2d side(r1 - r0, y1 - y0);
  const double outside = std::min({segment_distance(at, {0, y0}, {r0, y0}), segment_distance(at, {r0, y0}, {r1, y1}),
                                   segment_distance(at, {r1, y1}, {0, y1})});
  const bool inside = at.y() > y0 && at.y() < y1 && side.y() * (at.x() - r0) - side.x() * (at.y() - y0) < 0.0;
  return (inside ? -outside : outside) - rounding;
}

double sheet_distance(const Primitive& p, const Vector3d& x) {
  const Vector3d xa = x - p.a, xb = x - p.b, xc = x - p.c;
  if (p.length > 0.0 && p.axes.col(0).dot(xa) >= 0.0 && p.axes.col(1).dot(xb) >= 0.0 && p.axes.col(2).dot(xc) >= 0.0) {
    return std::abs(p.unit.dot(xa)) - p.ra;
  }
  const Vector3d ab = p.b - p.a, bc = p.c - p.b, ca = p.a - p.c;
  const auto edge = [](const Vector3d& from, const Vector3d& along) {
    const double t = std::clamp(from.dot(along) / std::max(along.squaredNorm(), 1e-24), 0.0, 1.0);
    return (from - t * along).squaredNorm();
  };
  return std::sqrt(std::min({edge(xa, ab), edge(xb, bc), edge(xc, ca)})) - p.ra;
}

}  // namespace

void settle(Primitive& p) {
  if (p.shape == Primitive::Shape::kSheet) {
    const Vector3d ab = p.b - p.a, bc = p.c - p.b, ca = p.a - p.c;
    const Vector3d normal = ab.cross(bc);
    p.length = normal.norm();  // twice the area; 0 for a sheet without one
    if (p.length < 1e-12) p.length = 0.0;
    if (p.length > 0.0) p.unit = normal / p.length;
    p.axes << p.unit.cross(ab), p.unit.cross(bc), p.unit.cross(ca);  // point inwards from the edges
    return;
  }
  const Vector3d axis = p.b - p.a;
  p.length = axis.norm();
  if (p.length < 1e-12) p.length = 0.0;
  if (p.length > 0.0) p.unit = axis / p.length;
  // Where one end ball holds the other the formula would have no solution; the clamp keeps it close.
  const double k = p.length > 0.0 ? std::clamp((p.rb - p.ra) / p.length, -0.999, 0.999) : 0.0;
  p.lean = k / std::sqrt(1.0 - k * k);
}

double signed_distance(const Primitive& p, const Vector3d& x) {
  switch (p.shape) {
    case Primitive::Shape::kCone:
      return cone_distance(p, x);
    case Primitive::Shape::kEllipsoid:
      return ellipsoid_distance(p, x);
    case Primitive::Shape::kBox:
      return box_distance(p.axes.transpose() * (x - p.a), p.half - Vector3d::Constant(p.ra)) - p.ra;
    case Primitive::Shape::kCylinder:
      return cylinder_distance(p, x);
    case Primitive::Shape::kSheet:
      return sheet_distance(p, x);
  }
  return 1e300;
}

double distance_bound(const Primitive& p, const Vector3d& x) {
  if (p.shape != Primitive::Shape::kEllipsoid) return signed_distance(p, x);
  const Vector3d local = p.axes.transpose() * (x - p.a);
  const double outer = box_distance(local, p.half);
  if (outer > 0.0) return outer;
  // Inside the bounding box: the ellipsoid contains x with at least this margin, or may be touched at once.
  return std::min(0.0, (local.cwiseQuotient(p.half).norm() - 1.0) * p.half.minCoeff());
}

double surface_area(const Primitive& p) {
  switch (p.shape) {
    case Primitive::Shape::kCone:
      return kPi * ((p.ra + p.rb) * (p.b - p.a).norm() + 2.0 * p.ra * p.ra + 2.0 * p.rb * p.rb);
    case Primitive::Shape::kEllipsoid: {
      const double xy = p.half.x() * p.half.y(), xz = p.half.x() * p.half.z(), yz = p.half.y() * p.half.z();
      return 4.0 * kPi * std::pow((std::pow(xy, 1.6) + std::pow(xz, 1.6) + std::pow(yz, 1.6)) / 3.0, 1.0 / 1.6);
    }
    case Primitive::Shape::kBox:
      return 8.0 * (p.half.x() * p.half.y() + p.half.x() * p.half.z() + p.half.y() * p.half.z());
    case Primitive::Shape::kCylinder:
      return kPi * ((p.ra + p.rb) * (p.b - p.a).norm() + p.ra * p.ra + p.rb * p.rb);
    case Primitive::Shape::kSheet:
      return (p.b - p.a).cross(p.c - p.a).norm();
  }
  return 0.0;
}

void bounds(const Primitive& p, Vector3d& low, Vector3d& high) {
  switch (p.shape) {
    case Primitive::Shape::kCone:
    case Primitive::Shape::kCylinder:
      low = (p.a.array() - p.ra).min(p.b.array() - p.rb);
      high = (p.a.array() + p.ra).max(p.b.array() + p.rb);
      break;
    case Primitive::Shape::kEllipsoid:
    case Primitive::Shape::kBox: {
      const Vector3d reach = p.axes.cwiseAbs() * p.half;
      low = p.a - reach;
      high = p.a + reach;
      break;
    }
    case Primitive::Shape::kSheet:
      low = p.a.cwiseMin(p.b).cwiseMin(p.c).array() - p.ra;
      high = p.a.cwiseMax(p.b).cwiseMax(p.c).array() + p.ra;
      break;
  }
}

void ensure_thickness(Primitive& p, double spacing) {
  // A ball of 0.87 spacings always holds a grid point; a slab needs 0.5 on either side.
  switch (p.shape) {
    case Primitive::Shape::kCone:
      p.ra = std::max(p.ra, 0.9 * spacing);
      p.rb = std::max(p.rb, 0.9 * spacing);
      break;
    case Primitive::Shape::kEllipsoid:
      p.half = p.half.cwiseMax(0.9 * spacing);
      break;
    case Primitive::Shape::kBox:
      p.half = p.half.cwiseMax(0.75 * spacing);
      p.ra = std::min(std::max(p.ra, 0.9 * spacing), 0.95 * p.half.minCoeff());
      break;
    case Primitive::Shape::kCylinder:
      p.ra = std::max(p.ra, 0.9 * spacing);
      p.rb = std::max(p.rb, 0.9 * spacing);
      p.half.x() = std::min({std::max(p.half.x(), 0.9 * spacing), 0.9 * p.ra, 0.9 * p.rb, 0.45 * (p.b - p.a).norm()});
      break;
    case Primitive::Shape::kSheet:
      p.ra = std::max(p.ra, 0.62 * spacing);
      break;
  }
  settle(p);
}

}  // namespace anigen::prepare
