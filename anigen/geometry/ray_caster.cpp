#include "anigen/geometry/ray_caster.h"

#include <limits>

#include "anigen/core/error.h"
#include "anigen/geometry/embree.h"

namespace anigen::geometry {

struct RayCaster::Implementation {
  Implementation(const std::vector<Eigen::Vector3f>& vertices, const std::vector<Triangle>& faces)
      : tree(vertices, faces) {}
  EmbreeMesh tree;
};

RayCaster::RayCaster(const std::vector<Eigen::Vector3f>& vertices, const std::vector<Triangle>& faces) {
  if (faces.empty()) throw InputError("", "mesh.faces", "a mesh without faces has no surface");
  implementation_ = std::make_unique<Implementation>(vertices, faces);
}

RayCaster::~RayCaster() = default;
RayCaster::RayCaster(RayCaster&&) noexcept = default;
RayCaster& RayCaster::operator=(RayCaster&&) noexcept = default;

std::optional<double> RayCaster::first_hit(const Eigen::Vector3d& origin, const Eigen::Vector3d& direction,
                                           double nearest) const {
  if (!origin.allFinite()) throw InputError("", "ray", "its origin is not finite");
  // stableNorm: the length of a tiny or huge direction is still right.
  const double length = direction.allFinite() ? direction.stableNorm() : 0.0;
  if (!(length > 0.0)) throw InputError("", "ray", "its direction is zero or not finite");
  if (origin.cwiseAbs().maxCoeff() > kLargestCoordinate) return std::nullopt;
  const Eigen::Vector3f along = (direction / length).cast<float>();
  RTCRayHit query;
  query.ray.org_x = static_cast<float>(origin.x());
  query.ray.org_y = static_cast<float>(origin.y());
  query.ray.org_z = static_cast<float>(origin.z());
  query.ray.dir_x = along.x();
  query.ray.dir_y = along.y();
  query.ray.dir_z = along.z();
  query.ray.tnear = static_cast<float>(nearest);
  query.ray.tfar = std::numeric_limits<float>::infinity();
  query.ray.time = 0.0f;
  query.ray.mask = 0xFFFFFFFFu;
  query.ray.id = 0;
  query.ray.flags = 0;
  query.hit.geomID = RTC_INVALID_GEOMETRY_ID;
  query.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
  embree_intersect(implementation_->tree.scene(), query);
  if (query.hit.geomID == RTC_INVALID_GEOMETRY_ID) return std::nullopt;
  return static_cast<double>(query.ray.tfar);
}

}  // namespace anigen::geometry
