#pragma once
#include <Eigen/Core>
#include <string>
#include <vector>

namespace anigen::geometry {

/// Names that tell where a joint is. The tree is cut into chains: from the root on, a chain goes on with the child that
/// leads farthest (sum of bone lengths to the farthest tip), except that of two children that mirror each other neither
/// goes on for both; every other child begins a chain. Chains are numbered from
/// the root outwards, longest first, and joints within a chain from 0: `chain_0_03`. Two chains that begin at the same
/// joint or at mirrored ones, have as many joints, and mirror each other across the plane of constant x through the
/// root share a number and tell their side: `chain_2.L_03`, left being +x, the left of one who faces −y (glTF's +Z).
/// Where every joint lies in one point there is nothing to tell: `joint_017`, by index.
///
/// Small movements of joints keep the names, unless two chains are about as long as each other.
/// @param positions [J], Z up @param parents [J], parents first, root first with -1
/// @return [J], unique
std::vector<std::string> joint_names(const std::vector<Eigen::Vector3d>& positions, const std::vector<int>& parents);

}  // namespace anigen::geometry
