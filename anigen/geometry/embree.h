#pragma once
#include <Eigen/Core>

#if ANIGEN_EMBREE_VERSION == 4
#include <embree4/rtcore.h>
#elif ANIGEN_EMBREE_VERSION == 3
#include <embree3/rtcore.h>
#else
#error "ANIGEN_EMBREE_VERSION must be 3 or 4"
#endif

// The only place that knows which Embree this is; for geometry/triangle_tree_embree.cpp, and for the benchmark that
// calls Embree without our tree around it.

namespace anigen::geometry {

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

}  // namespace anigen::geometry
