#pragma once
#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "anigen/asset/asset.h"

namespace anigen::raytrace {

/// Where a ray met the mesh.
struct Hit {
  std::int32_t face = -1;  ///< -1: nothing was hit
  double distance = 0.0;   ///< along the direction, in its length
  Eigen::Vector3f barycentric = Eigen::Vector3f::Zero();
  Eigen::Vector3f normal = Eigen::Vector3f::UnitZ();       ///< smooth, unit length, turned towards the viewer
  Eigen::Vector3f flat_normal = Eigen::Vector3f::UnitZ();  ///< of the face, turned towards the viewer
  bool front = true;                                       ///< the face's counter-clockwise side was hit
};

/// An asset's mesh ready for rays: set up once per pose, trace many times, from any thread. Double sided.
class Scene {
 public:
  /// @param asset must outlive the scene
  /// @param posed vertex positions to use in place of the asset's, [V]; normals follow
  /// @throws InputError when an array's length, an index or a number in the mesh is wrong
  explicit Scene(const Asset& asset, const std::optional<std::vector<Eigen::Vector3f>>& posed = std::nullopt);
  ~Scene();
  Scene(Scene&&) noexcept;
  Scene& operator=(Scene&&) noexcept;

  /// @param nearest distance from which on the surface counts
  Hit trace(const Eigen::Vector3d& origin, const Eigen::Vector3d& direction, double nearest = 0.0) const;

  /// Rays of neighbouring pixels, which the tree takes together about three times as fast as one by one.
  static constexpr std::size_t kBundle = 16;
  /// As trace() for directions of any length but zero; Hit::distance counts in that length.
  std::array<Hit, kBundle> trace(const Eigen::Vector3d& origin,
                                 const std::array<Eigen::Vector3f, kBundle>& directions) const;

  /// Whether anything lies between the origin and `distance` along the unit direction.
  bool occluded(const Eigen::Vector3f& origin, const Eigen::Vector3f& direction, float distance) const;

  /// A point near the hit from which shadow rays start: lifted to the smooth surface that the vertex normals imply,
  /// so that coarse meshes get no faceted shadow edges (Hanika, Ray Tracing Gems II, chapter 4).
  Eigen::Vector3f shadow_origin(const Hit& hit) const;

  const Asset& asset() const;
  const std::vector<Eigen::Vector3f>& vertices() const;
  const Box& box() const;  ///< empty for a mesh without faces
  float epsilon() const;   ///< how far off the surface secondary rays start

 private:
  struct Implementation;
  std::unique_ptr<Implementation> implementation_;
};

}  // namespace anigen::raytrace
