#pragma once
#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "anigen/render/scene.h"
#include "anigen/render/surface_color.h"

namespace anigen::render {

/// Points in the unit square that fill it evenly however many are taken (Roberts' R2 sequence), shifted by an amount
/// that depends on the pixel only. No state is shared between pixels, so pictures do not depend on threads.
class PixelSequence {
 public:
  /// @param skip points to leave out at the start
  PixelSequence(int x, int y, int skip = 0);
  Eigen::Vector2f next();

 private:
  float shift_x_, shift_y_;
  std::uint32_t index_;
};

/// Two lights far away and light from all around. Strengths are what a white surface that faces the light reflects,
/// linear.
struct LightRig {
  Eigen::Vector3f key_direction, fill_direction;  ///< unit, towards the light, world frame
  float key, fill;
  float above, below;  ///< from all around, for a surface that faces up or down
  float key_radius;    ///< of the key light's disc seen from one unit away: soft shadow edges
};

/// Turns with the camera, for pictures to look at: a key light from the upper left behind the viewer, a fill light from
/// the right, and light from all around that is weaker from below.
LightRig studio_lights(const Camera& camera);

/// Stands still in the world, for views to learn from, so that all views of an object agree: what Blender's lights of
/// the published renders amount to on an object of size 1 (docs/reference/training.md, 1.1). A small key light in the
/// direction (4, 1, 6), a sheet over the whole sky, which an unobstructed surface sees in proportion to how far up it
/// faces, and a weak light from below and from the key's opposite side in place of light that bounces.
LightRig dataset_lights();

class Cutout;

/// Scene of a posed rig.
class Studio {
 public:
  /// @param occlusion_rays per shading point, for the light from all around; 0 switches the occlusion off
  /// @param shadows whether the key light casts them
  /// @param holes where light passes through surfaces; nullptr: nowhere
  Studio(const Scene& scene, const LightRig& rig, int occlusion_rays, bool shadows, const Cutout* holes = nullptr);

  /// Light that a white surface reflects at a hit, linear grey; about 1 where fully lit.
  float light(const Hit& hit, PixelSequence& sequence) const;

  /// Darkness in [0, 1) that the object casts on a floor under it, at the ray's point on the floor; 0 where the ray
  /// misses the floor or is far from the object.
  float floor_shadow(const Eigen::Vector3d& origin, const Eigen::Vector3d& direction, PixelSequence& sequence) const;

 private:
  bool blocked(const Eigen::Vector3f& point, const Eigen::Vector3f& direction, float distance) const;
  float key_visible(const Eigen::Vector3f& point, PixelSequence& sequence) const;
  float openness(const Eigen::Vector3f& point, const Eigen::Vector3f& normal, int rays, PixelSequence& sequence) const;

  const Scene* scene_;
  const Cutout* holes_;
  LightRig rig_;
  float reach_;  ///< how far occlusion and shadows look
  int occlusion_rays_;
  bool shadows_;
};

/// Holes of a surface whose base colour texture is transparent: leaf cards, hair, torn cloth.
///
/// A material that says what it does with alpha (Material::alpha_mode) is taken at its word: opaque ones have no holes,
/// masks have them below their own cutoff. Of others alpha may be meant or only stored (games keep other masks there),
/// so it counts only where it leaves something of the material: when more than kLargestHole of its surface would
/// vanish, the material stays solid.
class Cutout {
 public:
  static constexpr double kLargestHole = 0.9;

  /// @param scene,colors must outlive this; colors in PictureMode::kColor
  /// @param cutoff alpha below this is a hole, but of masks; 0: nothing is
  Cutout(const Scene& scene, const SurfaceColor& colors, float cutoff);

  bool empty() const { return cutoffs_.empty(); }
  bool passes(const Hit& hit) const;

  /// The first surface that is no hole along a ray whose first hit is `hit`; as Scene::trace otherwise.
  Hit behind_holes(const Eigen::Vector3d& origin, const Eigen::Vector3d& direction, Hit hit) const;
  /// As Scene::occluded, through holes.
  bool occluded(const Eigen::Vector3f& origin, const Eigen::Vector3f& direction, float distance) const;

 private:
  const Scene* scene_;
  const SurfaceColor* colors_;
  std::vector<float> cutoffs_;  ///< per material, of the texture's alpha, 0: no holes; empty when no material has any
};

}  // namespace anigen::render
