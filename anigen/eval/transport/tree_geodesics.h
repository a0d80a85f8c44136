#pragma once
#include <Eigen/Core>

#include "anigen/io/rigs/joint_tree.h"

namespace anigen::eval {

/// Distances along the skeleton: sums of bone lengths on the path between two joints. A forest is first joined by
/// connected(), so every distance is finite. Time and memory O(n^2).
/// Source: reference training-and-data.md, 7.3.
/// @param tree n joints, parents in any order  @return [n,n] symmetric, zero diagonal, in the unit of the positions
/// @throws InputError as check()
Eigen::MatrixXd tree_geodesics(const io::JointTree& tree);

}  // namespace anigen::eval
