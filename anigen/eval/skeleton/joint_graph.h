#pragma once
#include <Eigen/Core>
#include <array>
#include <vector>

#include "anigen/io/rigs/joint_tree.h"

namespace anigen::eval {

/// Joints and bones without the promise of a tree: what is left after joints were merged (see puppeteer_cleaned()).
struct JointGraph {
  std::vector<Eigen::Vector3d> joints;
  std::vector<std::array<int, 2>> bones;  ///< parent, child
};

/// One bone per joint that has a parent, in joint order. @throws InputError as check()
JointGraph joint_graph(const io::JointTree& tree);

/// A bone as a line, from the parent's position to the child's.
struct BoneLine {
  Eigen::Vector3d head, tail;
};

/// The bones as lines; a skeleton without bones gives its joints, as lines without length, so that the bone distances
/// stay defined (reference training-and-data.md, 7.2).
std::vector<BoneLine> bone_lines(const JointGraph& graph);

}  // namespace anigen::eval
