#include "anigen/geometry/nearest_surface.h"

#include <cmath>
#include <limits>
#include <string>

#include "anigen/core/error.h"
#include "anigen/core/parallel.h"
#include "anigen/geometry/embree.h"
#include "anigen/geometry/segment.h"

namespace anigen::geometry {

NearestPoint nearest_on_triangle(const Eigen::Vector3d& p, const Eigen::Vector3d& a, const Eigen::Vector3d& b,
                                 const Eigen::Vector3d& c) {
  NearestPoint best;
  const Eigen::Vector3d ab = b - a, ac = c - a, ap = p - a;
  const Eigen::Vector3d normal = ab.cross(ac);
  const double squared = normal.squaredNorm();
  // Relative to the edges: a sliver's projection is rounding noise, while its edges are still exact.
  if (squared > 1e-24 * ab.squaredNorm() * ac.squaredNorm()) {
    const double v = ap.cross(ac).dot(normal) / squared, w = ab.cross(ap).dot(normal) / squared;
    if (v >= 0.0 && w >= 0.0 && v + w <= 1.0) {
      best.at.barycentric = {1.0 - v - w, v, w};
      best.position = a + v * ab + w * ac;
      best.distance = (best.position - p).norm();
      return best;
    }
  }
  // Not above the inside: the nearest point is on the boundary.
  const Eigen::Vector3d* corners[3] = {&a, &b, &c};
  best.distance = std::numeric_limits<double>::infinity();
  for (int k = 0; k < 3; ++k) {
    const int next = (k + 1) % 3;
    const double t = nearest_on_segment(p, *corners[k], *corners[next]);
    const Eigen::Vector3d position = *corners[k] + t * (*corners[next] - *corners[k]);
    const double distance = (position - p).norm();
    if (distance < best.distance) {
      best.distance = distance;
      best.position = position;
      best.at.barycentric.setZero();
      best.at.barycentric[k] = 1.0 - t;
      best.at.barycentric[next] = t;
    }
  }
  return best;
}

struct NearestSurface::Implementation {
  Implementation(const std::vector<Eigen::Vector3f>& v, const std::vector<Triangle>& f)
      : vertices(v), faces(f), tree(v, f) {
    for (const Eigen::Vector3f& vertex : vertices) extent = std::max(extent, double{vertex.cwiseAbs().maxCoeff()});
  }

  NearestPoint nearest_on_face(const Eigen::Vector3d& p, std::size_t face) const {
    const Triangle& t = faces[face];
    NearestPoint result = nearest_on_triangle(p, vertices[static_cast<std::size_t>(t[0])].cast<double>(),
                                              vertices[static_cast<std::size_t>(t[1])].cast<double>(),
                                              vertices[static_cast<std::size_t>(t[2])].cast<double>());
    result.at.face = static_cast<std::int32_t>(face);
    return result;
  }

  std::vector<Eigen::Vector3f> vertices;
  std::vector<Triangle> faces;
  EmbreeMesh tree;
  double extent = 0.0;  ///< largest coordinate of the mesh
};

namespace {

template <typename Mesh>
struct Search {
  const Mesh* mesh;
  Eigen::Vector3d point;
  double rounding;  ///< how far the BVH's single-precision distances may be off
  NearestPoint best;

  bool offer(std::size_t face) {
    const NearestPoint candidate = mesh->nearest_on_face(point, face);
    const bool tie = candidate.distance == best.distance && candidate.at.face < best.at.face;
    if (!(candidate.distance < best.distance) && !tie) return false;
    best = candidate;
    return true;
  }

  static bool visit(RTCPointQueryFunctionArguments* arguments) {
    auto& search = *static_cast<Search*>(arguments->userPtr);
    if (!search.offer(arguments->primID)) return false;
    // Keep the radius a little too large: equally near faces and rounding in the boxes stay inside.
    arguments->query->radius = static_cast<float>(search.best.distance * (1.0 + 1e-5) + search.rounding);
    return true;
  }
};

}  // namespace

NearestSurface::NearestSurface(const std::vector<Eigen::Vector3f>& vertices, const std::vector<Triangle>& faces) {
  if (faces.empty()) throw InputError("", "mesh.faces", "a mesh without faces has no surface");
  implementation_ = std::make_unique<Implementation>(vertices, faces);
}

NearestSurface::~NearestSurface() = default;
NearestSurface::NearestSurface(NearestSurface&&) noexcept = default;
NearestSurface& NearestSurface::operator=(NearestSurface&&) noexcept = default;

NearestPoint NearestSurface::query(const Eigen::Vector3d& point) const {
  if (!point.allFinite()) throw InputError("", "point", "the query point is not finite");
  Search<Implementation> search;
  search.mesh = implementation_.get();
  search.point = point;
  search.rounding = 1e-6 * (implementation_->extent + point.cwiseAbs().maxCoeff());
  search.best.distance = std::numeric_limits<double>::infinity();
  if (point.cwiseAbs().maxCoeff() <= kLargestCoordinate) {
    RTCPointQuery query;
    query.x = static_cast<float>(point.x());
    query.y = static_cast<float>(point.y());
    query.z = static_cast<float>(point.z());
    query.time = 0.0f;
    query.radius = std::numeric_limits<float>::infinity();
    RTCPointQueryContext context;
    rtcInitPointQueryContext(&context);
    rtcPointQuery(implementation_->tree.scene(), &query, &context, &Search<Implementation>::visit, &search);
  }
  // Too far away for single precision: look at every face.
  if (search.best.at.face < 0) {
    for (std::size_t face = 0; face < implementation_->faces.size(); ++face) search.offer(face);
  }
  return search.best;
}

namespace {

constexpr std::size_t kBlock = 256;  // enough work per task to hide its cost

template <typename Points>
std::vector<NearestPoint> query_all(const NearestSurface& surface, const Points& points) {
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (!points[i].allFinite()) {
      throw InputError("", "points[" + std::to_string(i) + "]", "the query point is not finite");
    }
  }
  std::vector<NearestPoint> results(points.size());
  parallel_for((points.size() + kBlock - 1) / kBlock, [&](std::size_t block) {
    const std::size_t end = std::min(points.size(), (block + 1) * kBlock);
    for (std::size_t i = block * kBlock; i < end; ++i) {
      results[i] = surface.query(Eigen::Vector3d(points[i].template cast<double>()));
    }
  });
  return results;
}

}  // namespace

std::vector<NearestPoint> NearestSurface::query(const std::vector<Eigen::Vector3d>& points) const {
  return query_all(*this, points);
}

std::vector<NearestPoint> NearestSurface::query(const std::vector<Eigen::Vector3f>& points) const {
  return query_all(*this, points);
}

}  // namespace anigen::geometry
