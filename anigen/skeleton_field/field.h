#pragma once
#include <Eigen/Core>
#include <string>
#include <vector>

#include "anigen/nn/torch.h"
#include "anigen/skeleton_field/voting.h"

namespace anigen::skeleton_field {

/// The skeleton as seen from points in space (docs/reference/training.md, 5; docs/reference/autoencoders.md, 4.2): what
/// the encoder reads and what the skeleton field learns to predict.

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

using torch::Tensor;

/// Meaning of the two confidence channels of the skeleton field (docs/reference/training.md, 4).
enum class FieldConfidence {
  kExplicit,  ///< learned towards a target; after a sigmoid (`jp_hyper_continuous`)
  kNone,      ///< there are none: every vote counts alike
  kLearned,   ///< the published alternative, C = eˣ + 1, whose barrier has no gradient in practice
  kBayesian   ///< ours in its place: logarithm s of the scale of a Laplace distribution (Kendall and Gal 2017)
};

/// The decoded skeleton field of one asset at the centres of its skeleton voxels (docs/reference/autoencoders.md, 4.5).
struct SkeletonField {
  Tensor positions;       ///< [M, 3] voxel centres (of each corner when the field stands on corners, before averaging)
  Tensor joints;          ///< [M, 3] votes, object space
  Tensor parents;         ///< [M, 3] votes, object space
  Tensor conf_j, conf_p;  ///< [M, 1] as the configuration activates them; undefined without confidence
  Tensor conf_skin;       ///< [M, 1]; undefined without
  Tensor skin_features;   ///< [M, S]
};

struct SkeletonTensors {
  Tensor joints;   ///< [J, 3] fp32
  Tensor parents;  ///< [J] int64, -1 for a root
};

/// The votes of a field on the CPU; confidences stay empty where the field has none.
/// @throws InputError when shapes do not fit
Votes votes_of(const SkeletonField& field);

/// Clusters votes into a skeleton; not differentiable. @param strategy "mean_shift" or "threshold"
/// @return on the device of the votes; parents are raw, see skeleton_field::GroupedSkeleton
/// @throws InputError on another strategy, when shapes do not fit, and as skeleton_field::mean_shift_grouping
SkeletonTensors group_votes(const SkeletonField& field, const std::string& strategy,
                            const MeanShiftOptions& mean_shift = {}, const ThresholdOptions& threshold = {});

struct JointSkinFeatures {
  Tensor features;  ///< [J, S]
  Tensor variance;  ///< scalar: mean over joints and channels of the weighted variance inside a joint
};
/// Each voxel belongs to the joint nearest its centre; features are means weighted by sigmoid(conf_skin), or 1 without
/// it; a joint without voxels gets zeros (docs/reference/autoencoders.md, 5.4). Differentiable in features and
/// confidence. Of equally near joints the first counts. fp32, or fp64 for fp64 features. Without joints both results
/// are empty or zero.
/// @param joints [J, 3] @throws InputError when shapes do not fit, or naming a joint or centre that is not finite
JointSkinFeatures joint_skin_features(const SkeletonField& field, const Tensor& joints);

}  // namespace anigen::skeleton_field
