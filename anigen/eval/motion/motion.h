#pragma once
#include <Eigen/Core>
#include <Eigen/Geometry>
#include <string>
#include <vector>

#include "anigen/asset/animation.h"
#include "anigen/asset/skeleton.h"
#include "anigen/eval/align/similarity.h"
#include "anigen/eval/skin/posing.h"
#include "anigen/io/rigs/joint_tree.h"

namespace anigen::eval {

/// One pose against the bind pose, in world axes: joints' own axes, which every rig chooses differently, are not in it.
struct MotionFrame {
  double time = 0.0;                      ///< seconds, ≥ 0
  std::vector<Eigen::Quaterniond> turns;  ///< [J] world rotation since the bind pose
  std::vector<Eigen::Vector3d> shifts;  ///< [J] joint's place minus where turns alone would have put it with the roots
                                        ///< staying (rigid_motions()): travel of the root, bones that stretch
};

/// What a clip does to a rig.
struct Motion {
  std::string name;
  io::JointTree joints;             ///< in the bind pose
  std::vector<MotionFrame> frames;  ///< at least one, times increase
  double scaling = 0.0;             ///< largest |factor − 1| by which a joint scaled what it moves: that part of a
                                    ///< clip is left out
};

/// A clip at `frames` equal steps from its first key to its last.
/// @pre the animation belongs to the skeleton (validate()) @throws InputError unless frames is in 1 … 10000
Motion motion_of(const Animation& animation, const Skeleton& skeleton, int frames);

/// What each joint does to its vertices in a frame. @pre the frame has one turn and shift per joint of the tree
std::vector<RigidMotion> rigid_motions(const io::JointTree& tree, const MotionFrame& frame);

/// The same motion of joints that a similarity has moved.
Motion transformed(const Similarity& similarity, Motion motion);

/// Whether frames differ, by more than 1e-3 of the skeleton's size or as many radians.
bool moves(const Motion& motion);

/// Largest side of the box around the joints; 1 for joints that are all in one place.
double size_of(const io::JointTree& tree);

}  // namespace anigen::eval
