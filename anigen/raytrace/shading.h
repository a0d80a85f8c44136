#pragma once
#include <Eigen/Core>
#include <cstdint>

#include "anigen/raytrace/camera.h"
#include "anigen/raytrace/scene.h"

namespace anigen::raytrace {

/// Points in the unit square that fill it evenly however many are taken (Roberts' R2 sequence), shifted by an amount
/// that depends on the pixel only. No state is shared between pixels, so pictures do not depend on threads.
class PixelSequence {
 public:
  PixelSequence(int x, int y);
  Eigen::Vector2f next();

 private:
  float shift_x_, shift_y_;
  std::uint32_t index_ = 0;
};

/// Soft studio light that turns with the camera: a key light from the upper left behind the viewer, a fill light
/// from the right, and light from all around that is weaker from below.
class Studio {
 public:
  /// @param occlusion_rays per shading point, for the light from all around; 0 switches the occlusion off
  /// @param shadows whether the key light casts them
  Studio(const Scene& scene, const Camera& camera, int occlusion_rays, bool shadows);

  /// What a white surface reflects at a hit, linear grey; about 1 where fully lit.
  float light(const Hit& hit, PixelSequence& sequence) const;

  /// Darkness in [0, 1) that the object casts on a floor under it, at the ray's point on the floor; 0 where the ray
  /// misses the floor or is far from the object.
  float floor_shadow(const Eigen::Vector3d& origin, const Eigen::Vector3d& direction, PixelSequence& sequence) const;

 private:
  float key_visible(const Eigen::Vector3f& point, PixelSequence& sequence) const;
  float openness(const Eigen::Vector3f& point, const Eigen::Vector3f& normal, int rays, PixelSequence& sequence) const;

  const Scene* scene_;
  Eigen::Vector3f key_, fill_;
  float reach_;  ///< how far occlusion and shadows look
  int occlusion_rays_;
  bool shadows_;
};

}  // namespace anigen::raytrace
