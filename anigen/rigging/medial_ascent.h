#pragma once
#include <Eigen/Core>
#include <vector>

#include "anigen/rigging/pinocchio_solid.h"

namespace anigen::rigging {

/// Moves points across a limb to its middle: each by gradient ascent of the depth in a solid, within the plane through
/// the point across its direction, to the nearest place that no step makes deeper. Points outside come to the solid as
/// far as `reach` lets them.
/// @param points [N], in the frame of the field @param along [N] directions, of any length; zero: the ascent is free
/// @param reach no point moves farther than this
/// @return [N] @throws InputError when lengths differ or the reach is negative or not finite
std::vector<Eigen::Vector3d> ascend_to_medial(const SolidField& field, const std::vector<Eigen::Vector3d>& points,
                                              const std::vector<Eigen::Vector3d>& along, double reach);

}  // namespace anigen::rigging
