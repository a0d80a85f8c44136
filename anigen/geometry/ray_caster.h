#pragma once
#include <Eigen/Core>
#include <memory>
#include <optional>
#include <vector>

#include "anigen/asset/mesh.h"

namespace anigen::geometry {

/// Where rays meet a mesh: set up once per mesh (a BVH), query many times. Distances are in single precision (relative
/// error about 1e-6 of the scene). Queries are thread-safe.
class RayCaster {
 public:
  /// Copies the mesh. @throws InputError without faces, on a bad index, or on a vertex that is not finite
  RayCaster(const std::vector<Eigen::Vector3f>& vertices, const std::vector<Triangle>& faces);
  explicit RayCaster(const Mesh& mesh) : RayCaster(mesh.vertices, mesh.faces) {}
  ~RayCaster();
  RayCaster(RayCaster&&) noexcept;
  RayCaster& operator=(RayCaster&&) noexcept;

  /// Distance from `origin` to the first surface that is at least `nearest` away along `direction` (of any length but
  /// zero); both sides of a triangle count. Nothing when the ray leaves the mesh.
  /// @throws InputError when the origin or the direction is not finite, or the direction is zero
  std::optional<double> first_hit(const Eigen::Vector3d& origin, const Eigen::Vector3d& direction,
                                  double nearest = 0.0) const;

 private:
  struct Implementation;
  std::unique_ptr<Implementation> implementation_;
};

}  // namespace anigen::geometry
