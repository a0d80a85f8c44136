#pragma once
#include <Eigen/Core>
#include <vector>

#include "anigen/raytrace/scene.h"
#include "anigen/raytrace/surface_color.h"

namespace anigen::raytrace {

/// Where a surface is a hole because its base colour texture is transparent there: leaf cards, hair, torn cloth.
///
/// An asset does not say whether a material means its alpha or only stores it (games keep other masks there), so a
/// material's alpha counts only where it leaves something of the material: when more than kLargestHole of its surface
/// would vanish, the material stays solid.
class Cutout {
 public:
  static constexpr double kLargestHole = 0.9;

  /// @param scene,colors must outlive this; colors in PictureMode::kColor
  /// @param cutoff alpha below this is a hole; 0: nothing is
  Cutout(const Scene& scene, const SurfaceColor& colors, float cutoff);

  bool empty() const { return holes_.empty(); }
  bool passes(const Hit& hit) const;

  /// The first surface that is no hole along a ray whose first hit is `hit`; as Scene::trace otherwise.
  Hit behind_holes(const Eigen::Vector3d& origin, const Eigen::Vector3d& direction, Hit hit) const;
  /// As Scene::occluded, through holes.
  bool occluded(const Eigen::Vector3f& origin, const Eigen::Vector3f& direction, float distance) const;

 private:
  const Scene* scene_;
  const SurfaceColor* colors_;
  float cutoff_;
  std::vector<bool> holes_;  ///< per material; empty when no material has any
};

}  // namespace anigen::raytrace
