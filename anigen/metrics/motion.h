#pragma once
#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "anigen/asset/animation.h"
#include "anigen/asset/skeleton.h"
#include "anigen/core/config.h"
#include "anigen/io/rigs/rigged_shape.h"
#include "anigen/metrics/deformation.h"
#include "anigen/metrics/similarity.h"

namespace anigen::metrics {

/// One pose against the bind pose, in world axes: joints' own axes, which every rig chooses differently, are not in it.
struct MotionFrame {
  double time = 0.0;                      ///< seconds, ≥ 0
  std::vector<Eigen::Quaterniond> turns;  ///< [J] world rotation since the bind pose
  std::vector<Eigen::Vector3d> shifts;  ///< [J] joint's place minus where turns alone would have put it with the roots
                                        ///< staying (rigid_motions()): travel of the root, bones that stretch
};

/// Motion of a rig in a clip.
struct Motion {
  std::string name;
  JointTree joints;                 ///< in the bind pose
  std::vector<MotionFrame> frames;  ///< at least one, times increase
  double scaling = 0.0;             ///< largest |factor − 1| by which a joint scaled what it moves: that part of a
                                    ///< clip is left out
};

/// A clip at `frames` equal steps from its first key to its last.
/// @pre the animation belongs to the skeleton (validate()) @throws InputError unless frames is in 1 … 10000
Motion motion_of(const Animation& animation, const Skeleton& skeleton, int frames);

/// Rigid motion of each joint in a frame. @pre the frame has one turn and shift per joint of the tree
std::vector<RigidMotion> rigid_motions(const JointTree& tree, const MotionFrame& frame);

/// Motion of joints that a similarity has moved.
Motion transformed(const Similarity& similarity, Motion motion);

/// True when frames differ, by more than 1e-3 of the skeleton's size or as many radians.
bool moves(const Motion& motion);

/// Largest side of the box around the joints; 1 for joints that are all in one place.
double size_of(const JointTree& tree);

inline constexpr int kSequencePoses = 5;

/// A motion for a skeleton that came without one: from the bind pose through the first kSequencePoses random poses of
/// the deformation error (random_rotations(), the same probability and angles) and back, a second between poses,
/// joints' local rotations on the shortest arc in between. Frames are evenly spread over the loop; the first one is the
/// bind pose. Decided by seed, asset and the skeleton alone.
/// @param asset its id @throws InputError as check(), and unless frames is in 1 … 10000
Motion pose_sequence(const JointTree& tree, std::uint64_t seed, const std::string& asset, int frames);

/// A motion that a user named.
struct MotionFile {
  Motion motion;   ///< Z up, the file's unit
  Json described;  ///< file, sha256, clip, number of joints: saved results are told apart by it
};

/// Reads "FILE" or "FILE#CLIP": .bvh, which has one clip, or a .glb, .gltf, .fbx or .dae that is rigged or has no mesh.
/// CLIP is a clip's name, else its number from 0; without it the first clip that moves.
/// @throws InputError naming the file: unreadable, another extension, no clip, no clip of that name (with those there
/// are), or nothing in it moves
MotionFile read_motion(const std::string& file_and_clip, int frames);

/// Largest distance of a piece of bone from its counterpart, in sizes (size_of()) of the source skeleton.
inline constexpr double kReach = 0.2;
/// For skeletons of different beings, each scaled to size 1: whatever can have a counterpart gets one.
inline constexpr double kFarReach = 1.0;

/// Correspondence of the joints of two skeletons: an exact transport plan like that of the metrics
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
Eigen::MatrixXd motion_plan(const JointTree& target, const JointTree& source, double reach = kReach);

/// Source joints with less than this share of a target joint's row of the plan do not turn it.
inline constexpr double kLeastShare = 0.1;

/// Transfers a motion to another skeleton. In every frame a target joint takes
///  - the world rotation since the bind pose of its source joints: their quaternions' mean (Markley et al. 2007),
///    weighted by the shares of its row of the plan. A bone that spans two bones of the source thus turns about as the
///    line through both does; the strongest of them alone would turn it too far, and switch from one to the other as a
///    prediction changes by a hair;
///  - their shift, weighted alike and times `scale`: the root's travel, and how bones stretch.
/// A joint whose row is empty moves with its parent; a root with the nearest source joint.
/// World rotations, not local ones, are handed over: neither the joints' own axes nor a joint more in between count.
/// Onto the same skeleton by its own plan nothing changes.
/// @param target in the frame of source.joints @param plan [n, m], motion_plan() or another one, not negative
/// @throws InputError when the plan's sizes or numbers are not such, or as check()
Motion retarget(const Motion& source, const JointTree& target, const Eigen::MatrixXd& plan, double scale = 1.0);

/// For a prediction that was brought into the frame of the motion: by motion_plan(), sizes as they are.
Motion retarget(const Motion& source, const JointTree& target);

/// For a motion of somebody else, a person's on a dragon: both skeletons centred by the boxes of their joints and
/// scaled to size 1, then matched by motion_plan() with kFarReach; shifts are scaled by the ratio of sizes. They count
/// from the first frame's root: motion capture starts anywhere in a room. Both must stand upright (+Z) and face the
/// same way.
Motion retarget_freely(const Motion& source, const JointTree& target);

/// A motion as a clip of the skeleton whose joints it moves: rotations and translations of every joint, linear keys at
/// the frames; scales only where the bind pose has others than the rest pose.
/// @throws InputError unless there is one joint of the skeleton per joint of the motion
Animation to_animation(const Motion& motion, const Skeleton& skeleton);

/// The clip of one skeleton as a clip of another: motion_of(), retarget() and to_animation().
/// @param plan [target joints, source joints], both in their bind poses @throws InputError as these
Animation retarget(const Animation& animation, const Skeleton& source, const Skeleton& target,
                   const Eigen::MatrixXd& plan, int frames, double scale = 1.0);

struct MotionScoreOptions {
  std::size_t samples = 5000;  ///< per surface and frame
  std::uint64_t seed = 0;      ///< of the samples
};

/// Distances between two meshes that move at the same time, in the unit of the input.
struct MotionScore {
  double moving = 0.0;     ///< mean over the frames
  double rest = 0.0;       ///< the same distance in the bind pose: what the shapes differ by before anything moves
  double largest = 0.0;    ///< of the frames
  bool by_vertex = false;  ///< what the distance is
};

/// The true mesh posed by the true rig beside the predicted mesh posed by the predicted rig. Distance of two meshes:
/// where they have the same faces and as many vertices, the mean distance of vertices with equal numbers; else
/// surface_scores()' symmetric Chamfer distance.
/// @param truth_motion, predicted_motion of the same frames @pre both shapes have a skin and faces
/// @throws InputError as surface_scores()
MotionScore motion_score(const io::RiggedShape& truth, const Motion& truth_motion, const io::RiggedShape& predicted,
                         const Motion& predicted_motion, const MotionScoreOptions& options = {});

/// The motion that a truth is scored in, on its own joints in the frame that `placement` leads to:
///  - `given`, where there is one: onto the truth by retarget_freely();
///  - else the truth's own first clip that moves;
///  - else pose_sequence() of (seed, id).
/// @param truth already placed @param placement from its file's frame
/// @throws InputError unless frames is in 1 … 10000; when the truth has no joints
Motion truth_motion(const io::RiggedShape& truth, const Similarity& placement, const Motion* given, std::uint64_t seed,
                    int frames);

}  // namespace anigen::metrics
