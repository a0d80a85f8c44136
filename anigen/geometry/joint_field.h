#pragma once
#include <Eigen/Core>
#include <array>
#include <vector>

namespace anigen::geometry {

/// The skeleton as seen from points in space (reference training-and-data.md, 5; autoencoders.md, 3.2): what the
/// encoder reads and what the skeleton field learns to predict.

/// The two joints nearest to a point.
struct NearestJoints {
  int joint = -1;       ///< the nearest; the lowest index of equally near ones
  double first = 0.0;   ///< squared distance to it
  double second = 0.0;  ///< squared distance to the second nearest; 0 when there is only one joint, as published
};

/// One result per point; runs on all threads. Distances are computed in double.
/// @throws InputError without joints, or naming a joint or a point that is not finite or beyond 1e100
std::vector<NearestJoints> nearest_joints(const std::vector<Eigen::Vector3d>& points,
                                          const std::vector<Eigen::Vector3d>& joints);

/// κ = 1 − min(1, d₁² / (d₂² + 1e-8)): 1 at a joint, 0 halfway between two, and 0 with a single joint.
double joint_confidence(const NearestJoints& nearest);
/// What the losses take instead: max(0.1, κ).
double target_confidence(const NearestJoints& nearest);

/// Whose position stands in for the parent of a joint that has none.
enum class RootParent {
  kFirstJoint,  ///< as in the published loss; for a root that is joint 0 the parent is the joint itself
  kLastJoint    ///< as in the published encoder, which then puts a learned vector in its place
};

struct JointFieldPoint {
  int joint = -1;             ///< nearest joint j
  int parent = -1;            ///< parent of that joint, -1 for a root
  Eigen::Vector3d to_joint;   ///< J_j − p
  Eigen::Vector3d to_parent;  ///< J_parent(j) − p
  double confidence = 0.0;    ///< κ, not clamped
};

/// The residual field at points: usually the centres of the dilated skeleton voxels.
/// @param joints [J] @param parents [J], -1 for roots
/// @throws InputError as nearest_joints, and when lengths differ or a parent is out of range
std::vector<JointFieldPoint> joint_field(const std::vector<Eigen::Vector3d>& points,
                                         const std::vector<Eigen::Vector3d>& joints, const std::vector<int>& parents,
                                         RootParent root = RootParent::kFirstJoint);

/// What a voxel votes for: the inverse of the residual field.
struct JointVote {
  Eigen::Vector3d joint, parent;                           ///< positions
  double joint_confidence = 0.0, parent_confidence = 0.0;  ///< in (0, 1)
};

/// @param center of the voxel @param channels of the decoder: joint 3 and parent 3 relative to the centre, then the
/// logits of both confidences (reference autoencoders.md, 3.6, with jp_residual_fields and jp_hyper_continuous)
JointVote joint_vote(const Eigen::Vector3d& center, const std::array<double, 8>& channels);

}  // namespace anigen::geometry
