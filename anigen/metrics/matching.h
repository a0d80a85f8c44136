#pragma once
#include <Eigen/Core>
#include <cstddef>
#include <vector>

#include "anigen/geometry/ray_caster.h"
#include "anigen/metrics/metric_skeleton.h"

namespace anigen::metrics {

/// Tie-breaking cost for coincident joints: how far their parents are from each other (a root is its own parent),
/// and a thousandth of the difference in depth. Added to a matching cost with a weight far below any distance that
/// matters, it makes a skeleton with coinciding joints match itself, however they are numbered.
/// @return [n, m] for skeletons of n and m joints, the unit of the positions
Eigen::MatrixXd joint_ties(const MetricSkeleton& predicted, const MetricSkeleton& truth);

/// The Wasserstein plan of two joint sets [n, m] (metrics/wasserstein.h) with such ties settled: what joints are
/// matched by when weights and poses go from one skeleton to the other. Its cost is within 1e-9 of the optimum in the
/// unit box.
Eigen::MatrixXd matching_plan(const MetricSkeleton& predicted, const MetricSkeleton& truth);

/// Matrices with more entries are refused; the time grows with the third power of the smaller side.
inline constexpr double kLargestAssignment = 4e6;

/// The linear assignment problem, exact: pairs as many rows and columns as the smaller side has, each at most once, at
/// the least total cost (shortest augmenting paths with potentials, O(min² · max); Jonker and Volgenant 1987).
/// @param cost [R, C], finite, any sign
/// @return [R]: the column of each row, -1 for rows that got none
/// @throws InputError for an entry that is not finite, or beyond kLargestAssignment
std::vector<int> assign(const Eigen::MatrixXd& cost);

/// Tolerance of joint matching without a mesh, in the unit box: Anymate's 0.1 in its box of side 2.
inline constexpr double kFixedTolerance = 0.05;
/// Rays per end of a bone.
inline constexpr int kToleranceRays = 14;

/// Joints matched one to one (RigNet; docs/reference/rignet.md, 6): the assignment of least total Euclidean distance,
/// of which only pairs nearer than the true joint's tolerance count.
struct JointMatch {
  std::vector<int> truth_of;  ///< [predicted]: the true joint, -1 without one that counts
  std::size_t matched = 0;    ///< m: pairs that count
  double iou = 0;             ///< 2 m / (predicted + true)
  double precision = 0;       ///< m / predicted
  double recall = 0;          ///< m / true
};

/// @param predicted, truth at least one joint each, finite @param tolerance [truth], a pair counts strictly below it
/// @throws InputError for no joints, lengths that differ, or beyond kLargestAssignment
JointMatch match_joints(const std::vector<Eigen::Vector3d>& predicted, const std::vector<Eigen::Vector3d>& truth,
                        const std::vector<double>& tolerance);
JointMatch match_joints(const std::vector<Eigen::Vector3d>& predicted, const std::vector<Eigen::Vector3d>& truth,
                        double tolerance = kFixedTolerance);

/// As above, for skeletons: joints that lie in one place are told apart by joint_ties().
JointMatch match_joints(const MetricSkeleton& predicted, const MetricSkeleton& truth,
                        const std::vector<double>& tolerance);

/// Half the local diameter of the shape at every joint, which RigNet's authors describe as the mean length of rays
/// from the joint, perpendicular to its bones, up to the surface. Here: 14 rays evenly around every bone that ends in
/// the joint (to its parent and to its children), in the plane through the joint; all hits farther than 1e-6 averaged.
/// A joint without a bone of positive length sends them around the three axes. Where no ray hits, `fallback`.
/// A joint outside the mesh measures what its rays meet there, if anything.
/// @return [J], the unit of the skeleton
std::vector<double> joint_tolerances(const MetricSkeleton& truth, const geometry::RayCaster& surface,
                                     double fallback = kFixedTolerance);

/// Bones of the ground truth that a prediction has. A predicted bone is right when both of its joints are matched
/// (see match_joints()) and their true joints are the two ends of one true bone, in either direction: a skeleton with
/// another root keeps its score. Since joints are matched one to one, each true bone is found at most once.
struct ConnectivityScore {
  std::size_t right = 0, predicted_bones = 0, true_bones = 0;
  double precision = 0;  ///< right / predicted bones; without any, 1 when there is no true bone either, else 0
  double recall = 0;     ///< right / true bones; without any, 1 when there is no predicted bone either, else 0
};

/// @param truth_of [predicted], each true joint at most once, -1 for none (JointMatch::truth_of)
/// @throws InputError when truth_of does not fit
ConnectivityScore connectivity(const MetricSkeleton& predicted, const MetricSkeleton& truth,
                               const std::vector<int>& truth_of);

/// |predicted joints − true joints|.
std::size_t joint_count_error(const MetricSkeleton& predicted, const MetricSkeleton& truth);

}  // namespace anigen::metrics
