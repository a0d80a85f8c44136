#pragma once
#include <Eigen/Core>

#include "anigen/geometry/ray_caster.h"

namespace anigen::features {

/// What rays from a place on the surface find, in the mesh's unit of length.
struct SurfaceSight {
  double near_openness = 1.0, far_openness = 1.0;  ///< share of directions free within the two radii, [0, 1]
  double thickness = 1.0;                          ///< along −normal, at most 1
  double gap = 1.0;                                ///< along +normal, at most 1
};

/// Casts 32 rays spread evenly over the cosine-weighted hemisphere about the normal, and one along either normal.
/// @param foot on the surface @param normal unit length @param lift how far off the surface the rays start, so that
///   the surface does not hide itself
SurfaceSight look_around(const geometry::RayCaster& caster, const Eigen::Vector3d& foot, const Eigen::Vector3d& normal,
                         double lift, double near_radius, double far_radius);

}  // namespace anigen::features
