#pragma once
#include <Eigen/Core>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "anigen/asset/mesh.h"

#if ANIGEN_EMBREE_VERSION == 4
#include <embree4/rtcore.h>
#elif ANIGEN_EMBREE_VERSION == 3
#include <embree3/rtcore.h>
#else
#error "ANIGEN_EMBREE_VERSION must be 3 or 4"
#endif

// The only place that knows which Embree this is. For sources of geometry and raytrace; other headers keep it out.

namespace anigen::geometry {

/// Coordinates beyond this are refused: Embree silently drops triangles near 1.8e18, and squares must stay finite.
inline constexpr float kLargestCoordinate = 1e15f;

/// @param file,array only for the message
/// @throws InputError naming the first vertex that is not finite or too large, or the first face with a bad index
void check_mesh(const std::vector<Eigen::Vector3f>& vertices, const std::vector<Triangle>& faces,
                const std::string& file = "", const std::string& array = "mesh");

/// A BVH over one triangle mesh; primitive ids are face indices. Queries are thread-safe.
class EmbreeMesh {
 public:
  /// Copies both arrays. @throws InputError as check_mesh; Error when Embree fails (out of memory)
  EmbreeMesh(const std::vector<Eigen::Vector3f>& vertices, const std::vector<Triangle>& faces);
  ~EmbreeMesh();
  EmbreeMesh(const EmbreeMesh&) = delete;
  EmbreeMesh& operator=(const EmbreeMesh&) = delete;

  RTCScene scene() const { return scene_; }

 private:
  RTCScene scene_ = nullptr;
};

/// A ray without an end that has hit nothing yet. @param nearest along it, in lengths of the direction
inline RTCRayHit embree_ray(const Eigen::Vector3f& origin, const Eigen::Vector3f& direction, float nearest) {
  RTCRayHit query{};
  query.ray.org_x = origin.x();
  query.ray.org_y = origin.y();
  query.ray.org_z = origin.z();
  query.ray.dir_x = direction.x();
  query.ray.dir_y = direction.y();
  query.ray.dir_z = direction.z();
  query.ray.tnear = nearest;
  query.ray.tfar = std::numeric_limits<float>::infinity();
  query.ray.mask = 0xFFFFFFFFu;
  query.hit.geomID = query.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
  return query;
}

/// Closest hit along the ray; hit.hit.geomID stays RTC_INVALID_GEOMETRY_ID on a miss.
inline void embree_intersect(RTCScene scene, RTCRayHit& hit) {
#if ANIGEN_EMBREE_VERSION == 4
  rtcIntersect1(scene, &hit);
#else
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  rtcIntersect1(scene, &context, &hit);
#endif
}

/// Closest hits of 16 rays that start close together and point about the same way. Lanes whose geomID stays
/// RTC_INVALID_GEOMETRY_ID missed. @param valid -1 for every lane in use, 0 for others, aligned to 64 bytes
inline void embree_intersect16(const int* valid, RTCScene scene, RTCRayHit16& hits) {
#if ANIGEN_EMBREE_VERSION == 4
  RTCIntersectArguments arguments;
  rtcInitIntersectArguments(&arguments);
  arguments.flags = RTC_RAY_QUERY_FLAG_COHERENT;
  rtcIntersect16(valid, scene, &hits, &arguments);
#else
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  context.flags = RTC_INTERSECT_CONTEXT_FLAG_COHERENT;
  rtcIntersect16(valid, scene, &context, &hits);
#endif
}

/// Any hit: sets ray.tfar to -infinity.
inline void embree_occluded(RTCScene scene, RTCRay& ray) {
#if ANIGEN_EMBREE_VERSION == 4
  rtcOccluded1(scene, &ray);
#else
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  rtcOccluded1(scene, &context, &ray);
#endif
}

/// Calls visit with `data` for the primitives whose boxes are within a radius that it may lower.
inline void embree_point_query(RTCScene scene, const Eigen::Vector3d& point, float radius, RTCPointQueryFunction visit,
                               void* data) {
  RTCPointQuery query;
  query.x = static_cast<float>(point.x());
  query.y = static_cast<float>(point.y());
  query.z = static_cast<float>(point.z());
  query.time = 0.0f;
  query.radius = radius;
  RTCPointQueryContext context;
  rtcInitPointQueryContext(&context);
  rtcPointQuery(scene, &query, &context, visit, data);
}

/// Intersections of rays with a mesh: set up once per mesh (a BVH), query many times. Distances are in single precision
/// (relative error about 1e-6 of the scene). Queries are thread-safe.
class RayCaster {
 public:
  /// Copies the mesh. @throws InputError without faces, on a bad index, or on a vertex that is not finite
  RayCaster(const std::vector<Eigen::Vector3f>& vertices, const std::vector<Triangle>& faces);
  explicit RayCaster(const Mesh& mesh) : RayCaster(mesh.vertices, mesh.faces) {}

  /// Distance from `origin` to the first surface that is at least `nearest` away along `direction` (of any length but
  /// zero); both sides of a triangle count. Nothing when the ray leaves the mesh.
  /// @throws InputError when the origin or the direction is not finite, or the direction is zero
  std::optional<double> first_hit(const Eigen::Vector3d& origin, const Eigen::Vector3d& direction,
                                  double nearest = 0.0) const;

  struct Hit {
    double distance;
    std::size_t face;  ///< index of the mesh's faces
  };
  /// The face that first_hit() hits.
  std::optional<Hit> first_face(const Eigen::Vector3d& origin, const Eigen::Vector3d& direction,
                                double nearest = 0.0) const;

 private:
  std::shared_ptr<const EmbreeMesh> mesh_;
};

}  // namespace anigen::geometry
