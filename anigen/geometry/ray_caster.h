#pragma once
#include <Eigen/Core>
#include <cstddef>
#include <memory>
#include <optional>
#include <vector>

#include "anigen/asset/mesh.h"
#include "anigen/geometry/triangle_tree.h"

namespace anigen::geometry {

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
  std::shared_ptr<const TriangleTree> tree_;
};

}  // namespace anigen::geometry
