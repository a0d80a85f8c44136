#pragma once
#include <Eigen/Core>
#include <vector>

namespace anigen::geometry {

/// The cycles of two or more joints that following parents runs into, each from the joint where it is entered, walking
/// from every joint in index order that no earlier walk has seen. -1 and a joint's own index end a walk.
/// @pre parents are in [-1, J)
std::vector<std::vector<int>> parent_cycles(const std::vector<int>& parents);

/// The same with -1 for every parent out of range.
std::vector<int> parents_in_range(const std::vector<int>& parents);

/// In double, the precision in which distances between joints are compared.
/// @throws InputError naming a joint that is not finite
std::vector<Eigen::Vector3d> checked_joints(const std::vector<Eigen::Vector3f>& joints);

}  // namespace anigen::geometry
