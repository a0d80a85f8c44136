#include "anigen/geometry/embree.h"

#include <cstring>

#include "anigen/core/error.h"

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

}  // namespace

void check_mesh(const std::vector<Eigen::Vector3f>& vertices, const std::vector<Triangle>& faces,
                const std::string& file, const std::string& array) {
  for (std::size_t v = 0; v < vertices.size(); ++v) {
    // Written so that NaN fails too.
    if (!(vertices[v].cwiseAbs().maxCoeff() <= kLargestCoordinate) || !vertices[v].allFinite()) {
      throw InputError(file, array + ".vertices[" + std::to_string(v) + "]",
                       "the position is not finite or larger than 1e15");
    }
  }
  const auto count = static_cast<std::int64_t>(vertices.size());
  for (std::size_t f = 0; f < faces.size(); ++f) {
    for (const std::int32_t index : faces[f]) {
      if (index < 0 || index >= count) {
        throw InputError(
            file, array + ".faces[" + std::to_string(f) + "]",
            "vertex index " + std::to_string(index) + " is outside the " + std::to_string(count) + " vertices");
      }
    }
  }
}

EmbreeMesh::EmbreeMesh(const std::vector<Eigen::Vector3f>& vertices, const std::vector<Triangle>& faces) {
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

EmbreeMesh::~EmbreeMesh() { rtcReleaseScene(scene_); }

RayCaster::RayCaster(const std::vector<Eigen::Vector3f>& vertices, const std::vector<Triangle>& faces) {
  if (faces.empty()) throw InputError("", "mesh.faces", "a mesh without faces has no surface");
  mesh_ = std::make_shared<EmbreeMesh>(vertices, faces);
}

std::optional<double> RayCaster::first_hit(const Eigen::Vector3d& origin, const Eigen::Vector3d& direction,
                                           double nearest) const {
  const std::optional<Hit> hit = first_face(origin, direction, nearest);
  return hit ? std::optional(hit->distance) : std::nullopt;
}

std::optional<RayCaster::Hit> RayCaster::first_face(const Eigen::Vector3d& origin, const Eigen::Vector3d& direction,
                                                    double nearest) const {
  if (!origin.allFinite()) throw InputError("", "ray", "its origin is not finite");
  // stableNorm: the length of a tiny or huge direction is still right.
  const double length = direction.allFinite() ? direction.stableNorm() : 0.0;
  if (!(length > 0.0)) throw InputError("", "ray", "its direction is zero or not finite");
  if (origin.cwiseAbs().maxCoeff() > kLargestCoordinate) return std::nullopt;
  RTCRayHit query = embree_ray(origin.cast<float>(), (direction / length).cast<float>(), static_cast<float>(nearest));
  embree_intersect(mesh_->scene(), query);
  if (query.hit.geomID == RTC_INVALID_GEOMETRY_ID) return std::nullopt;
  return Hit{static_cast<double>(query.ray.tfar), query.hit.primID};
}

}  // namespace anigen::geometry
