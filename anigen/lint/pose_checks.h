#pragma once
#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "anigen/lint/finding.h"
#include "anigen/lint/welded_rig.h"

namespace anigen::lint {

/// One joint turned, all others at rest. Linear blend skinning then needs one number per vertex: v goes to
/// v + s (R (v − c) + c − v) with s the weight of the joint and everything below it, c the joint.
struct JointTurn {
  std::size_t joint = 0;
  Eigen::Vector3d axis = Eigen::Vector3d::UnitX();  ///< unit length, across the bone
  double angle = 0.0;                               ///< radians
};

/// Turns of a joint by ±45° about two axes across its bone (to the middle of its children; of a tip, from its parent).
std::vector<JointTurn> turns_of_joint(const WeldedRig& rig, std::size_t joint);

/// Weight of a joint and everything below it [P].
std::vector<double> shares_moved(const WeldedRig& rig, std::size_t joint);

/// Places in a pose [P]. @param shares shares_moved() of the turn's joint
std::vector<Eigen::Vector3f> turned_places(const WeldedRig& rig, const JointTurn& turn,
                                           const std::vector<double>& shares);

/// The surface in poses: each joint that moves something, but the root, in its four turns; where that is too much
/// work, joints drawn by the seed. "stretched-faces": an edge more than 3 times as long; "inverted-faces": normals
/// against those that the turn gives them; "self-intersections": faces that cross others and did not at rest, in the
/// first two turns of at most 12 joints, those that move the most. Findings count the faces of the worst pose. Figures
/// alone: growth of the gaps between shells that touch at rest (metrics::ShellGaps), in diagonals, the largest of each
/// pair over the poses: `gap_growth_mean` over the `touching_shells` pairs, `gap_growth_max`.
void check_poses(const WeldedRig& rig, std::uint64_t seed, RigLint& lint);

}  // namespace anigen::lint
