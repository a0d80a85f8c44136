#pragma once
#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "anigen/asset/skeleton.h"
#include "anigen/asset/skin_weights.h"
#include "anigen/io/rigs/rigged_shape.h"

namespace anigen::metrics {

// Posing of rigs that are joints and weights only: no axes of joints, any order, forests too.

/// x ↦ turn · x + shift: what a joint does to the vertices that it moves.
struct RigidMotion {
  Eigen::Matrix3d turn = Eigen::Matrix3d::Identity();
  Eigen::Vector3d shift = Eigen::Vector3d::Zero();

  Eigen::Vector3d operator()(const Eigen::Vector3d& x) const { return turn * x + shift; }
};

/// Rest to posed when the joints have these orientations in the world (identity at rest): roots stay in place,
/// x_j = x_parent + R_parent (rest_j − rest_parent). @param order parents_first(tree)
std::vector<RigidMotion> rigid_motions(const JointTree& tree, const std::vector<int>& order,
                                       const std::vector<Eigen::Matrix3d>& orientations);

/// Linear blend skinning of one vertex with row v of the weights; an empty row counts as weight 1 on joint 0.
Eigen::Vector3d skinned(const Eigen::Vector3d& vertex, const SkinWeights& skin, std::size_t v,
                        const std::vector<RigidMotion>& joints);

/// The shape's own vertices moved by its own weights. @pre shape.has_skin()
std::vector<Eigen::Vector3f> posed_vertices(const io::RiggedShape& shape, const std::vector<RigidMotion>& joints);

struct DeformationOptions {
  int poses = 10;
  double probability = 0.5;         ///< that a joint turns in a pose
  double largest_angle_deg = 30.0;  ///< angles are uniform between 0 and this
  std::uint64_t seed = 0;
};

/// The local rotations of one pose, one per joint; every joint takes the same number of draws of
/// Rng(seed, "deformation", pose), whether it turns or not. @pre options in range
std::vector<Eigen::Matrix3d> random_rotations(std::size_t joints, const DeformationOptions& options, int pose);

/// Distances between vertices posed by the true rig and by the predicted one, in the unit of the input.
struct DeformationError {
  double mean = 0;  ///< over poses and vertices
  double max = 0;   ///< the largest of all
};

/// Effect of a wrong skeleton or wrong weights on an animation, RigNet's deformation error made precise:
///  1. In each pose true joints turn by random_rotations() Q_j: R_j = R_parent Q_j; positions follow (rigid_motions()).
///  2. A predicted joint takes the world orientation of the true joint that the plan gives most of its mass to
///     (strongest_match()); positions follow down the predicted tree. Orientations rather than local rotations are
///     handed over, so that a joint inserted in the middle of a bone does not turn it twice.
///  3. The true vertices are posed by linear blend skinning, v ↦ Σ_j w_vj (x_j + R_j (v − rest_j)), once with the true
///     rig and once with the predicted one.
/// Poses depend on the true skeleton only. Identical rigs give exactly 0; the numbering of predicted joints does not
/// matter.
/// @param vertices [V], of the true mesh @param predicted_on_truth predicted weights, one row per true vertex; an empty
///        row of either counts as weight 1 on joint 0
/// @param plan [n, m] as in matched_weights()
/// @throws InputError as check() and matched_weights(), for no vertex, rows or joints that do not fit, or options out
/// of range (poses in 1 … 10000, probability in [0, 1], angle finite and not negative)
DeformationError deformation_error(const std::vector<Eigen::Vector3d>& vertices, const JointTree& truth,
                                   const SkinWeights& truth_skin, const JointTree& predicted,
                                   const SkinWeights& predicted_on_truth, const Eigen::MatrixXd& plan,
                                   const DeformationOptions& options = {});

/// Vertices of both meshes in one pose.
struct PosedPair {
  std::vector<Eigen::Vector3f> truth, predicted;
};

/// One pose of deformation_error() for eyes: the true mesh moved by the true rig, and the predicted mesh, not the true
/// one, by the predicted rig. @pre both shapes have a skin @param pose number of the pose, from 0
/// @throws InputError as deformation_error()
PosedPair posed_pair(const io::RiggedShape& truth, const io::RiggedShape& predicted, const Eigen::MatrixXd& plan,
                     int pose, const DeformationOptions& options = {});

}  // namespace anigen::metrics
