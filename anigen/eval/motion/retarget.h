#pragma once
#include <Eigen/Core>

#include "anigen/eval/motion/motion.h"

namespace anigen::eval {

/// Source joints with less than this share of a target joint's row of the plan do not turn it.
inline constexpr double kLeastShare = 0.1;

/// The same motion on another skeleton. In every frame a target joint takes
///  - the world rotation since the bind pose of its source joints: their quaternions' mean, weighted by the shares of
///  its
///    row of the plan (the mean that is the closest rotation in the sense of Markley et al. 2007). A bone that spans
///    two bones of the source thus turns about as the line through both does; the strongest of them alone would turn it
///    too far, and switch from one to the other as a prediction changes by a hair;
///  - their shift, weighted alike and times `scale`: the root's travel, and how bones stretch.
/// A joint whose row is empty moves with its parent; a root with the nearest source joint.
/// World rotations, not local ones, are handed over: neither the joints' own axes nor a joint more in between count.
/// Onto the same skeleton by its own plan nothing changes.
/// @param target in the frame of source.joints @param plan [n, m], motion_plan() or another one, not negative
/// @throws InputError when the plan's sizes or numbers are not such, or as check()
Motion retarget(const Motion& source, const io::JointTree& target, const Eigen::MatrixXd& plan, double scale = 1.0);

/// For a prediction that was brought into the frame of the motion: by motion_plan(), sizes as they are.
Motion retarget(const Motion& source, const io::JointTree& target);

/// For a motion of somebody else, a person's on a dragon: both skeletons centred by the boxes of their joints and
/// scaled to size 1, then matched by motion_plan() with kFarReach; shifts are scaled by the ratio of sizes. They count
/// from the first frame's root: motion capture starts anywhere in a room. Both must stand upright (+Z) and face the
/// same way.
Motion retarget_freely(const Motion& source, const io::JointTree& target);

/// A motion as a clip of the skeleton whose joints it moves: rotations and translations of every joint, linear keys at
/// the frames; scales only where the bind pose has others than the rest pose.
/// @throws InputError unless there is one joint of the skeleton per joint of the motion
Animation to_animation(const Motion& motion, const Skeleton& skeleton);

/// The clip of one skeleton as a clip of another: motion_of(), retarget() and to_animation().
/// @param plan [target joints, source joints], both in their bind poses @throws InputError as these
Animation retarget(const Animation& animation, const Skeleton& source, const Skeleton& target,
                   const Eigen::MatrixXd& plan, int frames, double scale = 1.0);

}  // namespace anigen::eval
