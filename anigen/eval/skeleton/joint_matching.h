#pragma once
#include <Eigen/Core>
#include <vector>

#include "anigen/geometry/ray_caster.h"
#include "anigen/io/rigs/joint_tree.h"

namespace anigen::eval {

/// Tolerance of joint matching without a mesh, in the unit box: Anymate's 0.1 in its box of side 2.
inline constexpr double kFixedTolerance = 0.05;
/// Rays per end of a bone.
inline constexpr int kToleranceRays = 14;

/// Joints matched one to one (RigNet; reference anymate-baselines.md, 9.3): the assignment of least total Euclidean
/// distance, of which only pairs nearer than the true joint's tolerance count.
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

/// The same for skeletons: joints that lie in one place are told apart by joint_ties().
/// @throws InputError also as check()
JointMatch match_joints(const io::JointTree& predicted, const io::JointTree& truth,
                        const std::vector<double>& tolerance);

/// Half the local diameter of the shape at every joint, which RigNet's authors describe as the mean length of rays
/// from the joint, perpendicular to its bones, up to the surface. Here: 14 rays evenly around every bone that ends in
/// the joint (to its parent and to its children), in the plane through the joint; all hits farther than 1e-6 averaged.
/// A joint without a bone of positive length sends them around the three axes. Where no ray hits, `fallback`.
/// A joint outside the mesh measures what its rays meet there, if anything.
/// @return [J], the unit of the tree @throws InputError as check()
std::vector<double> joint_tolerances(const io::JointTree& truth, const geometry::RayCaster& surface,
                                     double fallback = kFixedTolerance);

}  // namespace anigen::eval
