#include "anigen/creatures/shapes.h"

#include <cmath>
#include <cstdint>
#include <utility>

#include "anigen/core/numeric.h"

namespace anigen::creatures {

using Eigen::Vector2d;
using Eigen::Vector3d;

namespace {

/// A uniform number in [0, 1) for a lattice point.
double lattice(std::int64_t x, std::int64_t y, std::int64_t z) {
  auto h = static_cast<std::uint64_t>(x) * 0x8DA6B343ull + static_cast<std::uint64_t>(y) * 0xD8163841ull +
           static_cast<std::uint64_t>(z) * 0xCB1AB31Full;
  h = (h ^ (h >> 33)) * 0xFF51AFD7ED558CCDull;
  h = (h ^ (h >> 33)) * 0xC4CEB9FE1A85EC53ull;
  return static_cast<double>((h ^ (h >> 33)) >> 11) * 0x1.0p-53;
}

/// Smooth noise in [0, 1], features of unit size.
double noise(const Vector3d& x) {
  const Vector3d cell = x.array().floor();
  const Vector3d f = x - cell;
  const Vector3d t = f.array() * f.array() * (3.0 - 2.0 * f.array());
  double sum = 0.0;
  for (int corner = 0; corner < 8; ++corner) {
    const int i = corner & 1, j = (corner >> 1) & 1, k = corner >> 2;
    const double weight = (i ? t.x() : 1 - t.x()) * (j ? t.y() : 1 - t.y()) * (k ? t.z() : 1 - t.z());
    sum += weight * lattice(static_cast<std::int64_t>(cell.x()) + i, static_cast<std::int64_t>(cell.y()) + j,
                            static_cast<std::int64_t>(cell.z()) + k);
  }
  return sum;
}

/// Distance to the nearest of the points scattered one per unit cell.
double nearest_spot(const Vector3d& x) {
  const Vector3d cell = x.array().floor();
  double best = 9.0;
  for (int n = 0; n < 27; ++n) {
    const Vector3d c = cell + Vector3d(n % 3 - 1, n / 3 % 3 - 1, n / 9 - 1);
    const auto i = static_cast<std::int64_t>(c.x()), j = static_cast<std::int64_t>(c.y()),
               k = static_cast<std::int64_t>(c.z());
    const Vector3d point = c + Vector3d(lattice(i, j, k), lattice(i + 71, j, k), lattice(i, j + 71, k));
    best = std::min(best, (x - point).squaredNorm());
  }
  return std::sqrt(best);
}

Vector3d mix(const Vector3d& a, const Vector3d& b, double t) { return a + (b - a) * std::clamp(t, 0.0, 1.0); }

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

// A trapezoid in the half plane (distance from the axis, height).
double cylinder_distance(const Primitive& p, const Vector3d& x) {
  const double rounding = p.half.x();
  const double length = p.length;
  const Vector3d from = x - p.a;
  const double y = from.dot(p.unit);
  const Vector2d at(std::sqrt(std::max(from.squaredNorm() - y * y, 0.0)), y);
  const double r0 = p.ra - rounding, r1 = p.rb - rounding, y0 = rounding, y1 = length - rounding;
  const Vector2d side(r1 - r0, y1 - y0);
  const auto to_edge = [&](const Vector2d& from, const Vector2d& to) { return segment_distance(at, from, to); };
  const double outside =
      std::min({to_edge({0, y0}, {r0, y0}), to_edge({r0, y0}, {r1, y1}), to_edge({r1, y1}, {0, y1})});
  const bool inside = at.y() > y0 && at.y() < y1 && side.y() * (at.x() - r0) - side.x() * (at.y() - y0) < 0.0;
  return (inside ? -outside : outside) - rounding;
}

double sheet_distance(const Primitive& p, const Vector3d& x) {
  const Vector3d xa = x - p.a, xb = x - p.b, xc = x - p.c;
  if (p.length > 0.0 && p.axes.col(0).dot(xa) >= 0.0 && p.axes.col(1).dot(xb) >= 0.0 && p.axes.col(2).dot(xc) >= 0.0)
    return std::abs(p.unit.dot(xa)) - p.ra;
  const Vector3d ab = p.b - p.a, bc = p.c - p.b, ca = p.a - p.c;
  const auto edge = [](const Vector3d& from, const Vector3d& along) {
    const double t = std::clamp(from.dot(along) / std::max(along.squaredNorm(), 1e-24), 0.0, 1.0);
    return (from - t * along).squaredNorm();
  };
  return std::sqrt(std::min({edge(xa, ab), edge(xb, bc), edge(xc, ca)})) - p.ra;
}

}  // namespace

double smoothstep(double low, double high, double x) {
  const double t = std::clamp((x - low) / (high - low), 0.0, 1.0);
  return t * t * (3.0 - 2.0 * t);
}

Vector3d paint_color(const Paint& paint, const Vector3d& x, const Vector3d& normal, const Vector3d& center,
                     const Vector3d& look) {
  if (paint.pattern == Paint::Pattern::kEye) {
    const double facing = (x - center).normalized().dot(look);
    if (facing > 0.66) return paint.accent;
    return facing > 0.4 ? paint.base : paint.under;
  }
  const double belly = paint.down.isZero() ? 0.0 : smoothstep(0.05, 0.75, normal.dot(paint.down));
  const Vector3d at = x * paint.frequency + Vector3d::Constant(paint.phase);
  double pattern = 0.0;
  switch (paint.pattern) {
    case Paint::Pattern::kStripes: {
      const double wobble = 1.6 * noise(0.8 * at);
      pattern = smoothstep(0.35, 0.65, 0.5 + 0.5 * std::sin(2.0 * kPi * (at.dot(paint.along) + wobble)) - 0.1);
      break;
    }
    case Paint::Pattern::kBands:
      pattern = smoothstep(0.4, 0.6, 0.5 + 0.5 * std::sin(2.0 * kPi * at.dot(paint.along)));
      break;
    case Paint::Pattern::kSpots:
      pattern = 1.0 - smoothstep(0.28, 0.42, nearest_spot(at));
      break;
    case Paint::Pattern::kMottled:
      pattern = 0.7 * noise(at) + 0.3 * noise(2.3 * at);
      break;
    case Paint::Pattern::kPanels:
      pattern = std::abs(at.dot(paint.along) - std::round(at.dot(paint.along))) < 0.08 ? 1.0 : 0.0;
      break;
    case Paint::Pattern::kPlain:
    case Paint::Pattern::kEye:
      break;
  }
  const Vector3d coat = mix(paint.base, paint.accent, paint.strength * pattern * (1.0 - 0.8 * belly));
  return mix(coat, paint.under, belly).cwiseMax(0.0).cwiseMin(1.0);
}

Vector3d color_of(double hue, double saturation, double value) {
  const auto channel = [&](double shift) {
    const double turn = hue + shift - std::floor(hue + shift);
    const double ramp = std::clamp(std::abs(turn * 6.0 - 3.0) - 1.0, 0.0, 1.0);
    const double srgb = value * (1.0 - saturation + saturation * ramp);
    return srgb <= 0.04045 ? srgb / 12.92 : std::pow((srgb + 0.055) / 1.055, 2.4);
  };
  return {channel(0.0), channel(2.0 / 3.0), channel(1.0 / 3.0)};
}

Paint plain(const Vector3d& color) {
  Paint paint;
  paint.base = paint.under = paint.accent = color;
  paint.down = Vector3d::Zero();
  return paint;
}

Paint shade(const Paint& paint, double factor) {
  Paint result = paint;
  result.pattern = Paint::Pattern::kPlain;
  for (Vector3d* color : {&result.base, &result.under, &result.accent}) *color = (*color * factor).cwiseMin(1.0);
  return result;
}

Paint random_coat(Rng& rng, double size, const Vector3d& along) {
  Paint paint;
  // Half of the animals wear natural colours (browns, greys, sands), half are as bright as toys.
  const bool natural = rng.chance(0.5);
  const double hue = natural ? rng.uniform(0.04, 0.13) : rng.uniform();
  const double saturation = natural ? rng.uniform(0.15, 0.6) : rng.uniform(0.45, 0.85);
  const double value = natural ? rng.uniform(0.35, 0.9) : rng.uniform(0.55, 0.95);
  paint.base = color_of(hue, saturation, value);
  paint.under = color_of(hue + rng.uniform(-0.04, 0.04), 0.4 * saturation, std::min(1.0, value + 0.3));
  const bool darker = value > 0.55 || rng.chance(0.5);
  paint.accent =
      color_of(hue + rng.uniform(-0.12, 0.12), saturation, darker ? 0.35 * value : std::min(1.0, 1.6 * value));
  constexpr Paint::Pattern kPatterns[] = {Paint::Pattern::kPlain, Paint::Pattern::kStripes, Paint::Pattern::kSpots,
                                          Paint::Pattern::kMottled, Paint::Pattern::kBands};
  paint.pattern = kPatterns[rng.index(5)];
  paint.strength = rng.uniform(0.55, 0.95);
  paint.frequency = rng.uniform(5.0, 9.0) / size;
  paint.phase = rng.uniform(0.0, 50.0);
  paint.along = along;
  return paint;
}

Paint eye_paint(Rng& rng) {
  Paint paint;
  paint.pattern = Paint::Pattern::kEye;
  paint.under = color_of(0.12, 0.05, 0.97);
  paint.base = color_of(rng.uniform(), 0.7, rng.uniform(0.4, 0.8));
  paint.accent = Vector3d::Constant(0.01);
  return paint;
}

Paint machine_paint(Rng& rng, bool bright) {
  // Bright machines are yellow to orange-red or green to blue, never pink.
  const double hue = rng.uniform(-0.03, 0.68);
  Paint paint = plain(bright ? color_of(hue, rng.uniform(0.6, 0.88), rng.uniform(0.65, 0.92))
                             : color_of(rng.uniform(0.5, 0.7), rng.uniform(0.0, 0.12), rng.uniform(0.18, 0.85)));
  return paint;
}

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
  // When one end ball holds the other the formula would have no solution; the clamp keeps it close.
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
    if (distances[n] < nearest + 2.0 * reach + primitives_[list[n]].blend)
      blend = std::max(blend, primitives_[list[n]].blend);
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

}  // namespace anigen::creatures
