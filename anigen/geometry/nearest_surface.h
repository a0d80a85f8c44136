#pragma once
#include <Eigen/Core>
#include <cstdint>
#include <memory>
#include <vector>

#include "anigen/asset/mesh.h"
#include "anigen/asset/skin_weights.h"

namespace anigen::geometry {

/// A place on a triangle mesh: a face and barycentric weights of its three corners (≥ 0, sum 1).
struct SurfacePoint {
  std::int32_t face = -1;
  Eigen::Vector3d barycentric = Eigen::Vector3d::Zero();
};

Eigen::Vector3d position(const SurfacePoint& point, const std::vector<Eigen::Vector3f>& vertices,
                         const std::vector<Triangle>& faces);

/// Skin weights at places on the surface: Σ_corner barycentric · row(corner), one row per point. A row without any
/// positive weight becomes weight 1 on joint 0, as from_dense does.
/// @param weights one row per vertex @throws InputError when a face refers to a missing row
SkinWeights interpolate_skin(const SkinWeights& weights, const std::vector<Triangle>& faces,
                             const std::vector<SurfacePoint>& points);

struct NearestPoint {
  SurfacePoint at;           ///< face and barycentric weights
  Eigen::Vector3d position;  ///< on the surface, the mesh's frame
  double distance = 0.0;
};

/// Nearest point on one triangle; a triangle without area counts as its edges. Exact in double precision.
NearestPoint nearest_on_triangle(const Eigen::Vector3d& p, const Eigen::Vector3d& a, const Eigen::Vector3d& b,
                                 const Eigen::Vector3d& c);

/// Nearest point on a mesh's surface: set up once per mesh (a BVH), query many times. Exact: the BVH only prunes,
/// distances are computed in double. Equally near faces give the lowest index, so results do not depend on threads, on
/// guesses or on what was asked before.
/// Queries are thread-safe. Used wherever features move between meshes (docs/reference/training.md, 3.5;
/// docs/reference/flows.md, 5.6).
class NearestSurface {
 public:
  /// Copies the mesh. @throws InputError without faces, on a bad index, or on a vertex that is not finite
  NearestSurface(const std::vector<Eigen::Vector3f>& vertices, const std::vector<Triangle>& faces);
  /// Overload for vertices in double precision, which distances then refer to.
  NearestSurface(const std::vector<Eigen::Vector3d>& vertices, const std::vector<Triangle>& faces);
  explicit NearestSurface(const Mesh& mesh) : NearestSurface(mesh.vertices, mesh.faces) {}

  /// @throws InputError when the point is not finite or beyond 1e100
  NearestPoint query(const Eigen::Vector3d& point) const { return query(point, -1); }
  /// Returns an equal result, found sooner when `guess` is a face near the point: the answer for a point nearby. Any
  /// number is allowed; one that is no face is ignored.
  NearestPoint query(const Eigen::Vector3d& point, std::int32_t guess) const;
  /// One result per point, in order; runs on all threads. Points are visited along a space-filling curve, each starting
  /// from the answer before it: many at once are quicker than one by one. @throws InputError naming the point that is
  /// not finite
  std::vector<NearestPoint> query(const std::vector<Eigen::Vector3d>& points) const;
  std::vector<NearestPoint> query(const std::vector<Eigen::Vector3f>& points) const;

  /// The nearest point of every face that comes within `radius` of the point, nearest first, equally near ones by
  /// index: all the places that a query on touching or coinciding surfaces could have meant.
  /// @throws InputError as query(), or when the radius is negative or not finite
  std::vector<NearestPoint> within(const Eigen::Vector3d& point, double radius) const;

 private:
  struct Implementation;
  std::shared_ptr<const Implementation> implementation_;  ///< copies share it
};

}  // namespace anigen::geometry
