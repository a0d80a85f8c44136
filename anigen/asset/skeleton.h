#pragma once
#include <Eigen/Core>
#include <Eigen/Geometry>
#include <string>
#include <vector>

namespace anigen {

/// Translation, rotation and scale of a joint relative to its parent; matrix() = T · R · S as in glTF.
struct Transform {
  Eigen::Vector3d translation = Eigen::Vector3d::Zero();
  Eigen::Quaterniond rotation = Eigen::Quaterniond::Identity();
  Eigen::Vector3d scale = Eigen::Vector3d::Ones();
  Eigen::Matrix4d matrix() const;
};

/// Nearest T · R · S of an affine matrix (polar decomposition; a mirroring goes into the scale's x).
/// @param shear_error set to the largest entry of |matrix - result.matrix()| relative to the matrix' scale
Transform decompose(const Eigen::Matrix4d& matrix, double* shear_error = nullptr);

/// A rooted tree of joints, parents before children: parents[0] = -1 and parents[j] < j for every other j.
/// All arrays have one entry per joint. World frame: right-handed, Z up.
struct Skeleton {
  std::vector<std::string> names;  ///< unique, not empty
  std::vector<int> parents;
  std::vector<Eigen::Matrix4d> bind;  ///< joint → world in the bind pose; its inverse is glTF's inverse bind matrix
  std::vector<Transform> rest;        ///< relative to the parent (to the world for the root): the file's rest pose,
                                      ///< which animations start from and which may differ from the bind pose

  std::size_t size() const { return parents.size(); }
  /// Joint positions in the bind pose, [J], world frame.
  std::vector<Eigen::Vector3d> positions() const;
};

/// One pose: a transform relative to the parent per joint.
using Pose = std::vector<Transform>;

/// World matrix of every joint, [J]. @pre pose has one entry per joint and parents come before children.
std::vector<Eigen::Matrix4d> forward_kinematics(const std::vector<int>& parents, const Pose& pose);

/// The pose relative to parents in which the joints have these world matrices (shear, if any, is dropped).
Pose local_pose(const std::vector<int>& parents, const std::vector<Eigen::Matrix4d>& world);
inline Pose bind_pose(const Skeleton& skeleton) { return local_pose(skeleton.parents, skeleton.bind); }

/// Identity rotations at the given joint positions, rest = bind. @throws InputError unless names are none or one each
Skeleton skeleton_from_joints(const std::vector<Eigen::Vector3d>& positions, const std::vector<int>& parents,
                              const std::vector<std::string>& names = {});

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
/// (docs/reference/training.md, 7.3).
JointTree connected(JointTree tree);

/// @throws InputError naming `file` and the joint: lengths differ, there is no joint, a parent is out of range or
/// the joint itself, a cycle, a position that is not finite
void check(const JointTree& tree, const std::string& file);

/// Every joint, none before its parent.
std::vector<int> parents_first(const JointTree& tree);

/// Digest of a tree, equal for trees that are equal up to the order of children, whatever the places of their joints:
/// trees get numbers from the leaves up (Aho, Hopcroft and Ullman's tree isomorphism). 32 hexadecimal digits.
/// @param parents [J], -1 for a root, in any order, without cycles; several roots count as children of one more
/// @return empty without joints
std::string tree_signature(const std::vector<int>& parents);

/// Parents of a tree through all points whose edges together are as short as possible (Prim 1957), hung up at the point
/// nearest to the mean of all; of equal choices the first. Time grows with the square of the number of points.
/// @param points [J], finite @return [J], -1 for the root; empty without points
/// @throws InputError naming a point that is not finite
std::vector<int> shortest_tree(const std::vector<Eigen::Vector3d>& points);

/// Parents of the likeliest tree where each joint chooses its parent by itself: among all trees with one root the one
/// of largest sum, the diagonal entry of the root included (Chu and Liu 1965, Edmonds 1967, by LEMON; the one root by a
/// source whose every edge costs more than all others together). Where the largest entries of the rows are a tree
/// already, it is that tree.
/// @param log_likelihood [J, J], finite: entry (i, m) of m being the parent of i, (i, i) of i being the root
/// @return [J], -1 for the root; empty without joints @throws InputError for another shape or an entry not finite
std::vector<int> likeliest_tree(const Eigen::MatrixXd& log_likelihood);

/// Names that tell where a joint is. The tree is cut into chains: from the root on, a chain goes on with the child that
/// leads farthest (sum of bone lengths to the farthest tip), except that of two children that mirror each other neither
/// goes on for both; every other child begins a chain. Chains are numbered from
/// the root outwards, longest first, and joints within a chain from 0: `chain_0_03`. Two chains that begin at the same
/// joint or at mirrored ones, have as many joints, and mirror each other across the plane of constant x through the
/// root share a number and tell their side: `chain_2_03_L`, left being +x, the left of one who faces −y (glTF's +Z).
/// The side stands last because that is where Blender looks for it when it mirrors poses and weights.
/// When all joints coincide no direction can be told: `joint_017`, by index.
///
/// Small movements of joints keep the names, unless two chains are about as long as each other.
/// @param positions [J], Z up @param parents [J], parents first, root first with -1
/// @return [J], unique
std::vector<std::string> joint_names(const std::vector<Eigen::Vector3d>& positions, const std::vector<int>& parents);

/// The joint on the other side per joint, of chains that joint_names() calls _L and _R; -1 for others.
/// @param positions, parents as there
std::vector<int> mirrored_joints(const std::vector<Eigen::Vector3d>& positions, const std::vector<int>& parents);

}  // namespace anigen
