#pragma once
#include <Eigen/Core>

#include "anigen/io/rigs/joint_tree.h"

namespace anigen::eval {

/// How far a piece of bone may lie from its counterpart, in sizes (size_of()) of the source skeleton.
inline constexpr double kReach = 0.2;
/// For skeletons of different beings, each scaled to size 1: whatever can have a counterpart gets one.
inline constexpr double kFarReach = 1.0;

/// Which joint of one skeleton corresponds to which of another: an exact transport plan like that of the metrics
/// (squared Euclidean cost, ties as in matching_plan()), but of the skeletons' bones in place of their joints.
///
/// Joints with equal masses, as `wasserstein` has them, do not serve to move a rig: five more joints on one bone draw
/// mass along the whole chain, and its far joints are given their neighbours' rotations. So each joint stands for the
/// bones to its children, which are what its rotation moves:
///  1. Bones are cut into pieces of at most 1/20 of the source's size (more where there would be over 400), each with
///     its length as mass, at its middle. A joint that no bone of any length leaves is one piece at its place, of mass
///     1/20.
///  2. Masses are lengths and not shares of a sum, and what has no counterpart within `reach` is matched with nothing
///     (partial transport: one more row and column at cost ½ reach²): an additional tail draws nothing from the legs.
///  3. Entry (t, s) is the length of target joint t's bones that lies on source joint s's.
/// A joint inserted in a bone thus gets that bone's joint, in whole; a bone across two gets both in proportion.
/// The order of joints does not matter: pieces are sorted by place before the plan is solved.
/// @return [n, m], target joints × source joints, lengths in source sizes; a row of zeros: no counterpart
/// @pre both are in one frame @throws InputError as check(); unless reach is positive and finite
Eigen::MatrixXd motion_plan(const io::JointTree& target, const io::JointTree& source, double reach = kReach);

}  // namespace anigen::eval
