#pragma once
#include <cstddef>

#include "anigen/eval/skeleton/joint_graph.h"
#include "anigen/io/rigs/joint_tree.h"

namespace anigen::eval {

inline constexpr double kPuppeteerMerge = 0.0025;    ///< joints nearer than this are one
inline constexpr double kPuppeteerConnect = 0.02;    ///< components nearer than this are joined in a joint
inline constexpr std::size_t kLargestForest = 3000;  ///< joints of a forest whose components can be connected

/// What MagicArticulate and Puppeteer do to prediction and ground truth before they measure (reference
/// anymate-baselines.md, 10.2 step 4). Thresholds are for a skeleton in the unit box.
///  1. In index order, a joint takes in all later joints nearer than 0.0025 that no other took; the group is replaced
///     by its first joint, or by the tree's first root when that is in it. The result need not be a tree any more.
///  2. Bones from a joint to itself and repeated bones go, then joints that no bone uses, other than the root.
///  3. While there are several components, the nearest two joints of different ones are made one (nearer than 0.02;
///     the lower index stays) or get a bone (from the lower index).
/// A skeleton without bones keeps its merged joints, which get no bones: the published evaluation leaves it out.
/// @throws InputError as check(), or for several components of more than kLargestForest joints
JointGraph puppeteer_cleaned(const io::JointTree& tree);

}  // namespace anigen::eval
