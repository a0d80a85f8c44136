#pragma once
#include <Eigen/Core>
#include <string>
#include <vector>

#include "anigen/asset/skeleton.h"

namespace anigen::io {

/// A skeleton as metrics see it: where joints are and how they hang together. Unlike Skeleton it may be a forest
/// (several parents of -1) and need not list parents first; the unit is whatever the caller normalised to.
struct JointTree {
  std::vector<Eigen::Vector3d> positions;  ///< [J]
  std::vector<int> parents;                ///< [J], -1 for a root

  std::size_t size() const { return positions.size(); }
};

JointTree joint_tree(const Skeleton& skeleton);

/// Joints without a parent, in order.
std::vector<int> roots(const JointTree& tree);

/// A forest as one tree: every further root becomes a child of the first one, which makes geodesics finite
/// (reference training-and-data.md, 7.3).
JointTree connected(JointTree tree);

/// @throws InputError naming `file` and the joint: lengths differ, there is no joint, a parent is out of range or
/// the joint itself, a cycle, a position that is not finite
void check(const JointTree& tree, const std::string& file);

}  // namespace anigen::io
