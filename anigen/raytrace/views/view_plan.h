#pragma once
#include <Eigen/Core>
#include <vector>

#include "anigen/core/random.h"

namespace anigen::raytrace {

/// A camera that looks at the origin with +Z up, from `radius` away. The eye is at
/// radius · (cos yaw cos pitch, sin yaw cos pitch, sin pitch). Angles in radians; `fov` is the full horizontal (and
/// vertical: pictures are square) field of view.
struct ViewCamera {
  double yaw = 0.0, pitch = 0.0, radius = 2.0, fov = 0.0;
};

/// Directions spread evenly over the sphere: yaw and pitch of point i of n of the Hammersley set, shifted by
/// (offset0 / n, offset1). Yaw is not wrapped. (Reference training-and-data.md, 1.1.)
/// @param upper remaps the set so that three quarters of it lie in the upper hemisphere, as the published data
/// preparation does; false: the plain set of the published previews
ViewCamera hammersley_view(std::size_t i, std::size_t n, double offset0, double offset1, bool upper);

inline constexpr double kFeatureRadius = 2.0;
inline constexpr double kFeatureFov = 0.69813170079773184;  ///< 40°

/// The cameras of `renders/`, from which features are computed: radius 2, field of view 40°, 75 % of them above.
/// @param offset0,offset1 uniform in [0, 1), drawn once per object @throws InputError when n is 0
std::vector<ViewCamera> feature_views(std::size_t n, double offset0, double offset1);

/// The cameras of `renders_cond/`, which image conditions come from: the same directions with random offsets, fields of
/// view between 10° and 70° and the radius at which the sphere around the unit cube just fills the picture
/// (1 / radius² is uniform). @throws InputError when n is 0
std::vector<ViewCamera> condition_views(std::size_t n, Rng& rng);

/// Ours, for data sets too small to learn what every side looks like: cameras in front of the object, which faces −Y,
/// as people take pictures. Yaw within 60° of the front, one camera in each n-th of that range; pitch from −5° to 30°;
/// field of view 40° and the radius that belongs to it. @throws InputError when n is 0
std::vector<ViewCamera> front_views(std::size_t n, Rng& rng);

/// Camera axes in columns and position: Blender's camera-to-world (looks along −Z, +Y up), [4,4]. Well defined at the
/// poles, too. @throws InputError when a number is not finite, the radius not positive or fov outside (0, π)
Eigen::Matrix4d camera_to_world(const ViewCamera& view);

}  // namespace anigen::raytrace
