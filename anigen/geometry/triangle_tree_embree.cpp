#include <cstring>

#include "anigen/core/error.h"
#include "anigen/geometry/embree.h"
#include "anigen/geometry/mesh_check.h"
#include "anigen/geometry/triangle_tree.h"

namespace anigen::geometry {

namespace {

/// One device for the process, never released: scenes in static storage may outlive any order of destruction.
RTCDevice device() {
  static RTCDevice device = [] {
    RTCDevice created = rtcNewDevice(nullptr);
    if (created == nullptr) throw Error("Embree cannot start on this processor");
    return created;
  }();
  return device;
}

RTCRayHit embree_ray(const TreeRay& ray) {
  RTCRayHit query{};
  query.ray.org_x = ray.origin.x();
  query.ray.org_y = ray.origin.y();
  query.ray.org_z = ray.origin.z();
  query.ray.dir_x = ray.direction.x();
  query.ray.dir_y = ray.direction.y();
  query.ray.dir_z = ray.direction.z();
  query.ray.tnear = ray.nearest;
  query.ray.tfar = ray.farthest;
  query.ray.mask = 0xFFFFFFFFu;
  query.hit.geomID = query.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
  return query;
}

struct Visitor {
  VisitFace visit;
  void* data;
};

bool visit_primitive(RTCPointQueryFunctionArguments* arguments) {
  const Visitor& visitor = *static_cast<const Visitor*>(arguments->userPtr);
  const float before = arguments->query->radius;
  const float after = visitor.visit(visitor.data, arguments->primID, before);
  if (!(after < before)) return false;
  arguments->query->radius = after;
  return true;
}

}  // namespace

EmbreeTree::EmbreeTree(const std::vector<Eigen::Vector3f>& vertices, const std::vector<Triangle>& faces) {
  check_mesh(vertices, faces);
  scene_ = rtcNewScene(device());
  // Without "robust" a ray through a shared edge can slip between the two triangles.
  rtcSetSceneFlags(scene_, RTC_SCENE_FLAG_ROBUST);
  if (!faces.empty()) {
    RTCGeometry geometry = rtcNewGeometry(device(), RTC_GEOMETRY_TYPE_TRIANGLE);
    void* positions = rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, 3 * sizeof(float),
                                              vertices.size());
    void* indices = rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3,
                                            3 * sizeof(std::int32_t), faces.size());
    if (positions == nullptr || indices == nullptr) {
      rtcReleaseGeometry(geometry);
      rtcReleaseScene(scene_);
      throw Error("out of memory while building a ray tracing structure over " + std::to_string(faces.size()) +
                  " faces");
    }
    static_assert(sizeof(Eigen::Vector3f) == 3 * sizeof(float), "vertices are packed");
    std::memcpy(positions, vertices.data()->data(), vertices.size() * sizeof(Eigen::Vector3f));
    std::memcpy(indices, faces.data(), faces.size() * sizeof(Triangle));
    rtcCommitGeometry(geometry);
    rtcAttachGeometry(scene_, geometry);
    rtcReleaseGeometry(geometry);
  }
  rtcCommitScene(scene_);
}

EmbreeTree::~EmbreeTree() { rtcReleaseScene(scene_); }

TreeHit EmbreeTree::first_hit(const TreeRay& ray) const {
  RTCRayHit query = embree_ray(ray);
  embree_intersect(scene_, query);
  if (query.hit.geomID == RTC_INVALID_GEOMETRY_ID) return {};
  return {query.hit.primID, query.ray.tfar, query.hit.u, query.hit.v};
}

BundleHits EmbreeTree::first_hits(const Eigen::Vector3f& origin, const RayBundle& directions) const {
  static_assert(kRayBundle == 16, "Embree is asked with packets of 16");
  alignas(64) std::array<int, kRayBundle> valid;
  valid.fill(-1);
  RTCRayHit16 query;
  for (std::size_t i = 0; i < kRayBundle; ++i) {
    query.ray.org_x[i] = origin.x();
    query.ray.org_y[i] = origin.y();
    query.ray.org_z[i] = origin.z();
    query.ray.tnear[i] = 0.0f;
    query.ray.dir_x[i] = directions[i].x();
    query.ray.dir_y[i] = directions[i].y();
    query.ray.dir_z[i] = directions[i].z();
    query.ray.time[i] = 0.0f;
    query.ray.tfar[i] = std::numeric_limits<float>::infinity();
    query.ray.mask[i] = 0xFFFFFFFFu;
    query.ray.id[i] = 0;
    query.ray.flags[i] = 0;
    query.hit.geomID[i] = RTC_INVALID_GEOMETRY_ID;
    query.hit.instID[0][i] = RTC_INVALID_GEOMETRY_ID;
  }
  embree_intersect16(valid.data(), scene_, query);
  BundleHits hits;
  for (std::size_t i = 0; i < kRayBundle; ++i) {
    if (query.hit.geomID[i] == RTC_INVALID_GEOMETRY_ID) continue;
    hits[i] = {query.hit.primID[i], query.ray.tfar[i], query.hit.u[i], query.hit.v[i]};
  }
  return hits;
}

bool EmbreeTree::is_blocked(const TreeRay& ray) const {
  RTCRay query = embree_ray(ray).ray;
  embree_occluded(scene_, query);
  return query.tfar < 0.0f;
}

void EmbreeTree::visit_within(const Eigen::Vector3d& point, float radius, VisitFace visit, void* data) const {
  Visitor visitor{visit, data};
  embree_point_query(scene_, point, radius, &visit_primitive, &visitor);
}

}  // namespace anigen::geometry
