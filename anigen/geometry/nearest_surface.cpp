#include "anigen/geometry/nearest_surface.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <string>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "anigen/core/parallel.h"
#include "anigen/geometry/bones.h"
#include "anigen/geometry/mesh_check.h"
#include "anigen/geometry/sampling.h"
#include "anigen/geometry/triangle_tree.h"

namespace anigen::geometry {

NearestPoint nearest_on_triangle(const Eigen::Vector3d& p, const Eigen::Vector3d& a, const Eigen::Vector3d& b,
                                 const Eigen::Vector3d& c) {
  NearestPoint best;
  const Eigen::Vector3d ab = b - a, ac = c - a, ap = p - a;
  const Eigen::Vector3d normal = ab.cross(ac);
  const double squared = normal.squaredNorm();
  // Relative to the edges: a sliver's projection is rounding noise, while its edges are still exact.
  if (squared > 1e-24 * ab.squaredNorm() * ac.squaredNorm()) {
    const double v = ap.cross(ac).dot(normal), w = ab.cross(ap).dot(normal);
    if (v >= 0.0 && w >= 0.0 && v + w <= squared) {
      best.at.barycentric = {1.0 - v / squared - w / squared, v / squared, w / squared};
      best.position = a + best.at.barycentric[1] * ab + best.at.barycentric[2] * ac;
      best.distance = (best.position - p).norm();
      // Rounding of the difference only; the weights are promised not to be negative.
      best.at.barycentric[0] = std::max(best.at.barycentric[0], 0.0);
      return best;
    }
  }
  // Not above the inside: the nearest point is on the boundary.
  const Eigen::Vector3d* corners[3] = {&a, &b, &c};
  double nearest = std::numeric_limits<double>::infinity(), along = 0.0;
  int edge = 0;
  for (int k = 0; k < 3; ++k) {
    const Eigen::Vector3d &start = *corners[k], &end = *corners[(k + 1) % 3];
    const double t = nearest_on_segment(p, start, end);
    const Eigen::Vector3d position = start + t * (end - start);
    const double distance = (position - p).squaredNorm();
    if (distance < nearest) {
      nearest = distance;
      best.position = position;
      along = t;
      edge = k;
    }
  }
  best.distance = std::sqrt(nearest);
  best.at.barycentric[edge] = 1.0 - along;
  best.at.barycentric[(edge + 1) % 3] = along;
  return best;
}

Eigen::Vector3d position(const SurfacePoint& point, const std::vector<Eigen::Vector3f>& vertices,
                         const std::vector<Triangle>& faces) {
  const Triangle& face = faces[at(point.face)];
  Eigen::Vector3d result = Eigen::Vector3d::Zero();
  for (int k = 0; k < 3; ++k) result += point.barycentric[k] * vertices[at(face[at(k)])].cast<double>();
  return result;
}

SkinWeights interpolate_skin(const SkinWeights& weights, const std::vector<Triangle>& faces,
                             const std::vector<SurfacePoint>& points) {
  SkinWeights result;
  result.offsets.reserve(points.size() + 1);
  for (std::size_t i = 0; i < points.size(); ++i) {
    const SurfacePoint& point = points[i];
    if (point.face < 0 || static_cast<std::size_t>(point.face) >= faces.size())
      throw InputError("", "points[" + std::to_string(i) + "]", "there is no face " + std::to_string(point.face));
    std::vector<Influence> row;
    for (int k = 0; k < 3; ++k) {
      const auto vertex = static_cast<std::size_t>(faces[at(point.face)][at(k)]);
      if (vertex >= weights.rows()) {
        throw InputError("", "faces[" + std::to_string(point.face) + "]",
                         "vertex " + std::to_string(vertex) + " has no skin weights; there are " +
                             std::to_string(weights.rows()) + " rows");
      }
      for (std::size_t n = 0; n < weights.row_size(vertex); ++n) {
        const Influence& influence = weights.row(vertex)[n];
        row.push_back({influence.joint, static_cast<float>(point.barycentric[k] * influence.weight)});
      }
    }
    if (!result.append_row(std::move(row))) {
      // append_row left an empty row behind; fill it in place.
      result.influences.push_back({0, 1.0f});
      result.offsets.back() = result.influences.size();
    }
  }
  return result;
}

struct NearestSurface::Implementation {
  Implementation(const std::vector<Eigen::Vector3f>& rounded, std::vector<Eigen::Vector3d> exact,
                 const std::vector<Triangle>& f)
      : vertices(std::move(exact)), faces(f), tree(rounded, f) {
    for (const Eigen::Vector3d& vertex : vertices) extent = std::max(extent, vertex.cwiseAbs().maxCoeff());
    planes.reserve(faces.size());
    for (const Triangle& face : faces) {
      const Eigen::Vector3d& a = corner(face, 0);
      const Eigen::Vector3d ab = corner(face, 1) - a, ac = corner(face, 2) - a;
      const Eigen::Vector3d normal = ab.cross(ac);
      const double length = normal.norm();
      // The direction of a sliver's normal is rounding noise: its plane bounds nothing.
      const bool sliver = !(length > 1e-6 * ab.norm() * ac.norm());
      const Eigen::Vector3d unit = sliver ? Eigen::Vector3d::Zero() : Eigen::Vector3d(normal / length);
      planes.push_back({unit.x(), unit.y(), unit.z(), unit.dot(a)});
    }
  }

  const Eigen::Vector3d& corner(const Triangle& face, std::size_t k) const { return vertices[at(face[k])]; }

  NearestPoint nearest_on_face(const Eigen::Vector3d& p, std::size_t face) const {
    const Triangle& t = faces[face];
    NearestPoint result = nearest_on_triangle(p, corner(t, 0), corner(t, 1), corner(t, 2));
    result.at.face = static_cast<std::int32_t>(face);
    return result;
  }

  /// Never more than the distance to the face, but for rounding: to its plane.
  double at_least(const Eigen::Vector3d& p, std::size_t face) const {
    const std::array<double, 4>& plane = planes[face];
    return std::abs(plane[0] * p.x() + plane[1] * p.y() + plane[2] * p.z() - plane[3]);
  }

  std::vector<Eigen::Vector3d> vertices;
  std::vector<Triangle> faces;
  std::vector<std::array<double, 4>> planes;  ///< unit normal and offset of every face, 0 for a sliver
  TriangleTree tree;
  double extent = 0.0;  ///< largest coordinate of the mesh
};

namespace {

template <typename Mesh>
struct Search {
  const Mesh* mesh;
  Eigen::Vector3d point;
  double rounding;  ///< how far the BVH's single-precision distances may be off
  double slack;     ///< how far a distance to a plane may be off
  NearestPoint best;

  bool offer(std::size_t face) {
    if (mesh->at_least(point, face) > best.distance + slack) return false;
    const NearestPoint candidate = mesh->nearest_on_face(point, face);
    const bool tie = candidate.distance == best.distance && candidate.at.face < best.at.face;
    if (!(candidate.distance < best.distance) && !tie) return false;
    best = candidate;
    return true;
  }

  /// A little too large: equally near faces and rounding in the boxes stay inside.
  float radius() const { return static_cast<float>(best.distance * (1.0 + 1e-5) + rounding); }

  static float visit(void* data, std::uint32_t face, float radius) {
    auto& search = *static_cast<Search*>(data);
    return search.offer(face) ? search.radius() : radius;
  }
};

constexpr double kLargestQuery = 1e100;  // squares stay finite
constexpr const char* kOutOfReach = "the query point is not finite or farther out than 1e100";

bool in_reach(const Eigen::Vector3d& point) {
  return point.allFinite() && point.cwiseAbs().maxCoeff() <= kLargestQuery;
}

void require_faces(const std::vector<Triangle>& faces) {
  if (faces.empty()) throw InputError("", "mesh.faces", "a mesh without faces has no surface");
}

std::vector<Eigen::Vector3f> in_single(const std::vector<Eigen::Vector3d>& points) {
  std::vector<Eigen::Vector3f> result;
  result.reserve(points.size());
  for (const Eigen::Vector3d& point : points) result.push_back(point.cast<float>());
  return result;
}

template <typename Mesh>
struct Collection {
  const Mesh* mesh;
  Eigen::Vector3d point;
  double radius;
  std::vector<NearestPoint> found;

  void offer(std::size_t face) {
    const NearestPoint candidate = mesh->nearest_on_face(point, face);
    if (candidate.distance <= radius) found.push_back(candidate);
  }

  static float visit(void* data, std::uint32_t face, float radius) {
    static_cast<Collection*>(data)->offer(face);
    return radius;
  }
};

constexpr std::size_t kQueriesPerTask = 256;  // enough work per task to hide its cost

}  // namespace

NearestSurface::NearestSurface(const std::vector<Eigen::Vector3f>& vertices, const std::vector<Triangle>& faces) {
  require_faces(faces);
  check_mesh(vertices, faces);
  implementation_ = std::make_shared<Implementation>(vertices, in_double(vertices), faces);
}

NearestSurface::NearestSurface(const std::vector<Eigen::Vector3d>& vertices, const std::vector<Triangle>& faces) {
  require_faces(faces);
  const std::vector<Eigen::Vector3f> rounded = in_single(vertices);
  check_mesh(rounded, faces);
  implementation_ = std::make_shared<Implementation>(rounded, vertices, faces);
}

NearestPoint NearestSurface::query(const Eigen::Vector3d& point, std::int32_t guess) const {
  if (!in_reach(point)) throw InputError("", "point", kOutOfReach);
  const double reach = implementation_->extent + point.cwiseAbs().maxCoeff();
  Search<Implementation> search;
  search.mesh = implementation_.get();
  search.point = point;
  search.rounding = 1e-6 * reach;
  search.slack = 1e-13 * reach;
  search.best.distance = std::numeric_limits<double>::infinity();
  const bool guessed = guess >= 0 && static_cast<std::size_t>(guess) < implementation_->faces.size();
  if (guessed) search.offer(static_cast<std::size_t>(guess));
  const bool in_range = point.cwiseAbs().maxCoeff() <= kLargestCoordinate;
  if (in_range) {
    implementation_->tree.visit_within(point, guessed ? search.radius() : std::numeric_limits<float>::infinity(),
                                       &Search<Implementation>::visit, &search);
  }
  // Too far away for single precision: look at every face.
  if (!in_range || search.best.at.face < 0) {
    for (std::size_t face = 0; face < implementation_->faces.size(); ++face) search.offer(face);
  }
  return search.best;
}

std::vector<NearestPoint> NearestSurface::within(const Eigen::Vector3d& point, double radius) const {
  if (!in_reach(point)) throw InputError("", "point", kOutOfReach);
  if (!(radius >= 0.0 && std::isfinite(radius))) throw InputError("", "radius", "must be a finite number ≥ 0");
  Collection<Implementation> collection{implementation_.get(), point, radius, {}};
  const double reach = implementation_->extent + point.cwiseAbs().maxCoeff();
  if (reach + radius <= kLargestCoordinate) {
    // Rounding of the boxes stays inside; exact distances decide.
    implementation_->tree.visit_within(point, static_cast<float>(radius * (1.0 + 1e-5) + 1e-6 * reach),
                                       &Collection<Implementation>::visit, &collection);
  } else {
    for (std::size_t face = 0; face < implementation_->faces.size(); ++face) collection.offer(face);
  }
  std::sort(collection.found.begin(), collection.found.end(), [](const NearestPoint& a, const NearestPoint& b) {
    return a.distance != b.distance ? a.distance < b.distance : a.at.face < b.at.face;
  });
  return std::move(collection.found);
}

std::vector<NearestPoint> NearestSurface::query(const std::vector<Eigen::Vector3d>& points) const {
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (!in_reach(points[i])) throw InputError("", "points[" + std::to_string(i) + "]", kOutOfReach);
  }
  const std::vector<std::uint32_t> order = along_curve(points);
  std::vector<NearestPoint> results(points.size());
  parallel_for((points.size() + kQueriesPerTask - 1) / kQueriesPerTask, [&](std::size_t block) {
    const std::size_t end = std::min(points.size(), (block + 1) * kQueriesPerTask);
    std::int32_t guess = -1;
    for (std::size_t i = block * kQueriesPerTask; i < end; ++i) {
      results[order[i]] = query(points[order[i]], guess);
      guess = results[order[i]].at.face;
    }
  });
  return results;
}

std::vector<NearestPoint> NearestSurface::query(const std::vector<Eigen::Vector3f>& points) const {
  return query(in_double(points));
}

}  // namespace anigen::geometry
