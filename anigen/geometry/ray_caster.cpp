#include "anigen/geometry/ray_caster.h"

#include "anigen/core/error.h"
#include "anigen/geometry/mesh_check.h"

namespace anigen::geometry {

RayCaster::RayCaster(const std::vector<Eigen::Vector3f>& vertices, const std::vector<Triangle>& faces) {
  if (faces.empty()) throw InputError("", "mesh.faces", "a mesh without faces has no surface");
  tree_ = std::make_shared<TriangleTree>(vertices, faces);
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
  const TreeHit hit =
      tree_->first_hit({origin.cast<float>(), (direction / length).cast<float>(), static_cast<float>(nearest)});
  if (!hit.found()) return std::nullopt;
  return Hit{static_cast<double>(hit.distance), hit.face};
}

}  // namespace anigen::geometry
