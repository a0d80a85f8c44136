#pragma once
#include <Eigen/Core>
#include <vector>

namespace anigen::skeleton_field {

/// The cycles of two or more joints that following parents runs into, each from the joint where it is entered, walking
/// from every joint in index order that no earlier walk has seen. -1 and a joint's own index end a walk.
/// @pre parents are in [-1, J)
std::vector<std::vector<int>> parent_cycles(const std::vector<int>& parents);

/// Parents without cycles (docs/reference/autoencoders.md, 5.5): out of range → -1, a cycle is re-parented at its joint
/// nearest to a joint outside, or opened when it holds every joint. A joint that is its own parent stays so, and counts
/// as a root. As published it gives up after max(4, J) rounds, since cuts can undo each other.
/// @param joints [J], or empty when positions are not known: a cycle then is opened at its first joint
/// @return the published result, which may still be cyclic then
/// @throws InputError when lengths differ or naming a joint that is not finite
std::vector<int> repair_parents_as_published(const std::vector<Eigen::Vector3f>& joints,
                                             const std::vector<int>& parents);

/// Value of hop_distances for joints that are not connected.
inline constexpr int kUnreachableHops = 1 << 29;

/// Hops between joints along the undirected skeleton, kUnreachableHops between joints that are not connected. Parents
/// out of range or equal to their joint count as none; cycles are allowed. Takes J² numbers. [J][J]
std::vector<std::vector<int>> hop_distances(const std::vector<int>& parents);

struct RootedTree {
  std::vector<int> order;    ///< old index of each joint, parents before children
  std::vector<int> parents;  ///< in the new order: -1 for joint 0 alone
};
/// Guarantees beyond the published repair: one root, no cycle, parents before children. A cycle is
/// opened at its joint nearest to a joint that does not hang on it. Further roots, in index order, become children of
/// the nearest joint outside their own subtree; the root is the one with the largest subtree, of equal ones the first.
/// Joints keep their order as far as parents come first: a tree that is sound already comes back as it is.
/// Time grows with roots · joints, not with depth.
/// @return empty without joints
/// @throws InputError when lengths differ or naming a joint that is not finite
RootedTree one_rooted_tree(const std::vector<Eigen::Vector3f>& joints, const std::vector<int>& parents);

}  // namespace anigen::skeleton_field
