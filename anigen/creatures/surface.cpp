#include "anigen/creatures/surface.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "anigen/core/disjoint_sets.h"
#include "anigen/core/numeric.h"
#include "anigen/creatures/weights.h"

namespace anigen::creatures {

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

namespace {

using Eigen::Vector3d;
using Index = BlockGrid::Index;

/// The mean of the points where the field changes sign along the cell's edges.
Vector3d first_guess(const BlockGrid& grid, const Index& cell) {
  Vector3d sum = Vector3d::Zero();
  int count = 0;
  for (int c = 0; c < 8; ++c) {
    for (int axis = 0; axis < 3; ++axis) {
      if (c >> axis & 1) continue;
      const Index a{cell[0] + (c & 1), cell[1] + ((c >> 1) & 1), cell[2] + (c >> 2)};
      Index b = a;
      ++b[axis];
      const double fa = grid.value(a), fb = grid.value(b);
      if ((fa < 0.0) == (fb < 0.0)) continue;
      sum += grid.node(a) + fa / (fa - fb) * (grid.node(b) - grid.node(a));
      ++count;
    }
  }
  return sum / count;
}

class Net {
 public:
  Net(const Field& field, double spacing) : field_(field), grid_(field, spacing) {
    if (!grid_.repair()) return;
    cells_ = grid_.mixed_cells();
    std::vector<int> vertex_of(grid_.storage_size(), -1);
    for (std::size_t v = 0; v < cells_.size(); ++v) {
      vertex_of[grid_.storage_index(cells_[v])] = static_cast<int>(v);
      surface_.vertices.push_back(first_guess(grid_, cells_[v]));
      surface_.vertex_lists.push_back(grid_.slot(cells_[v]));
    }
    for (const Index& cell : cells_) add_quads(cell, vertex_of);
    keep_largest_piece();
  }

  void project(int steps) {
    const double h = grid_.spacing();
    PrimitiveList list;
    for (std::size_t v = 0; v < cells_.size(); ++v) {
      Vector3d x = surface_.vertices[v];
      field_.narrow(x, grid_.lists()[surface_.vertex_lists[v]], h, list);
      for (int step = 0; step < steps; ++step) {
        const double f = field_.value(x, list);
        if (std::abs(f) < 1e-3 * h) break;
        const Vector3d g = field_.gradient(x, list, 0.03 * h);
        const double squared = g.squaredNorm();
        if (squared < 1e-4) break;
        Vector3d move = -f / squared * g;
        if (move.norm() > 0.5 * h) move *= 0.5 * h / move.norm();
        x += move;
      }
      surface_.vertices[v] = clamp(v, x);
    }
  }

  void relax() {
    std::vector<Vector3d> sums(cells_.size(), Vector3d::Zero());
    std::vector<int> counts(cells_.size(), 0);
    for (const auto& quad : quads_) {
      for (int k = 0; k < 4; ++k) {
        sums[quad[k]] += surface_.vertices[quad[(k + 1) % 4]];
        ++counts[quad[k]];
      }
    }
    for (std::size_t v = 0; v < cells_.size(); ++v) {
      if (counts[v] > 0) {
        surface_.vertices[v] = clamp(v, 0.5 * (surface_.vertices[v] + sums[v] / counts[v]));
      }
    }
  }

  Surface finish() {
    for (const auto& q : quads_) {
      // The diagonal that folds less sharply.
      const auto& x = surface_.vertices;
      const auto alignment = [&](int a, int b, int c, int d) {
        const Vector3d first = (x[b] - x[a]).cross(x[c] - x[a]), second = (x[c] - x[a]).cross(x[d] - x[a]);
        return first.dot(second) / std::max(first.norm() * second.norm(), 1e-30);
      };
      const int s = alignment(q[0], q[1], q[2], q[3]) >= alignment(q[1], q[2], q[3], q[0]) ? 0 : 1;
      surface_.faces.push_back({q[s], q[s + 1], q[s + 2]});
      surface_.faces.push_back({q[s], q[s + 2], q[(s + 3) % 4]});
    }
    set_normals();
    surface_.lists = grid_.take_lists();
    return std::move(surface_);
  }

 private:
  // A vertex that stays near its own cell cannot fold the mesh over.
  Vector3d clamp(std::size_t v, const Vector3d& x) const {
    const double h = grid_.spacing();
    const Vector3d low = grid_.node(cells_[v]).array() - 0.25 * h;
    return x.cwiseMax(low).cwiseMin((low.array() + 1.5 * h).matrix());
  }

  void add_quads(const Index& cell, const std::vector<int>& vertex_of) {
    const bool start = grid_.inside(cell);
    for (int axis = 0; axis < 3; ++axis) {
      Index end = cell;
      ++end[axis];
      if (grid_.inside(end) == start) continue;
      const int u = (axis + 1) % 3, v = (axis + 2) % 3;
      std::array<int, 4> quad{};
      for (int k = 0; k < 4; ++k) {
        Index around = cell;
        around[u] -= k == 1 || k == 2;
        around[v] -= k >= 2;
        quad[k] = vertex_of[grid_.storage_index(around)];
      }
      if (!start) std::swap(quad[1], quad[3]);
      quads_.push_back(quad);
    }
  }

  void keep_largest_piece() {
    DisjointSets pieces(cells_.size());
    for (const auto& quad : quads_) {
      for (int k = 1; k < 4; ++k) pieces.join(at(quad[0]), at(quad[k]));
    }
    const std::size_t none = cells_.size();
    std::size_t largest = none;
    for (std::size_t v = 0; v < cells_.size(); ++v) {
      if (pieces.find(v) == v && (largest == none || pieces.size_of(v) > pieces.size_of(largest))) largest = v;
    }
    if (largest == none || pieces.size_of(largest) == cells_.size()) return;
    std::vector<int> kept(cells_.size(), -1);
    int count = 0;
    for (std::size_t v = 0; v < cells_.size(); ++v) {
      if (pieces.find(v) != largest) continue;
      kept[v] = count;
      cells_[count] = cells_[v];
      surface_.vertices[count] = surface_.vertices[v];
      surface_.vertex_lists[count++] = surface_.vertex_lists[v];
    }
    cells_.resize(count);
    surface_.vertices.resize(count);
    surface_.vertex_lists.resize(count);
    std::vector<std::array<int, 4>> quads;
    for (auto quad : quads_) {
      if (kept[quad[0]] < 0) continue;
      for (int& v : quad) v = kept[v];
      quads.push_back(quad);
    }
    quads_ = std::move(quads);
  }

  void set_normals() {
    surface_.normals.assign(cells_.size(), Vector3d::Zero());
    for (const Triangle& t : surface_.faces) {
      const auto& x = surface_.vertices;
      const Vector3d n = (x[t[1]] - x[t[0]]).cross(x[t[2]] - x[t[0]]);
      for (int v : t) surface_.normals[v] += n;
    }
    PrimitiveList list;
    for (std::size_t v = 0; v < cells_.size(); ++v) {
      Vector3d& normal = surface_.normals[v];
      normal = normal.norm() > 1e-30 ? normal.normalized() : Vector3d::UnitZ();
      field_.narrow(surface_.vertices[v], grid_.lists()[surface_.vertex_lists[v]], 0.1 * grid_.spacing(), list);
      const Vector3d exact = field_.gradient(surface_.vertices[v], list, 0.03 * grid_.spacing());
      // When the mesh cannot follow the field (thin gaps, repaired cells) its own normal is the right one.
      if (exact.norm() > 0.1 && exact.normalized().dot(normal) > 0.6) normal = exact.normalized();
    }
  }

  const Field& field_;
  BlockGrid grid_;
  std::vector<Index> cells_;
  std::vector<std::array<int, 4>> quads_;
  Surface surface_;
};

std::vector<Primitive> prepared(std::vector<Primitive> primitives, double spacing) {
  for (Primitive& p : primitives) {
    ensure_thickness(p, spacing);
    p.blend = std::max(p.blend, 0.7 * spacing);
  }
  return primitives;
}

}  // namespace

double estimate_vertices(const std::vector<Primitive>& primitives, double spacing) {
  const double coarse = 2.5 * spacing;
  const Field field(prepared(primitives, spacing));
  return static_cast<double>(BlockGrid(field, coarse).mixed_cells().size()) * 6.25;
}

Surface extract_surface(const std::vector<Primitive>& primitives, double spacing, int relaxations) {
  const Field field(prepared(primitives, spacing));
  Net net(field, spacing);
  for (int n = 0; n < relaxations; ++n) {
    net.project(1);
    net.relax();
  }
  net.project(3);
  return net.finish();
}

}  // namespace anigen::creatures
