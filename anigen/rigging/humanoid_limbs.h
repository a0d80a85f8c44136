#pragma once
#include <Eigen/Core>
#include <array>
#include <vector>

#include "anigen/rigging/human_bones.h"

namespace anigen::rigging {

/// Hips, neck, head, limbs and fingers of a standing humanoid by tree and places alone, by bone; -1 where there is
/// none. The trunk between hips and arms is left out, and left is an assumption: along +across.
/// @param positions [J], Z up @param parents [J], parents first
/// @param carries [J] has skin weights: others are passed over, their children hang on what is above them; empty: all
/// @param across horizontal unit vector from one side to the other
std::array<int, kHumanBones> joints_by_place(const std::vector<Eigen::Vector3d>& positions,
                                             const std::vector<int>& parents, const std::vector<char>& carries,
                                             const Eigen::Vector3d& across);

}  // namespace anigen::rigging
