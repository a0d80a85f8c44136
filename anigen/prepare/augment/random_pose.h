#pragma once
#include <Eigen/Core>
#include <vector>

#include "anigen/asset/skeleton.h"
#include "anigen/core/random.h"

namespace anigen::prepare {

/// Rotations of joints about their own positions, [J]: the R_k of reference training-and-data.md, section 6. They are
/// written in axes parallel to the world's in the bind pose, and act on everything below the joint.
struct JointTurns {
  std::vector<Eigen::Matrix3d> rotations;
  std::vector<double> angles;  ///< radians; 0 for a joint that was left alone
};

/// Each joint, with `probability`, about an axis uniform on the sphere by an angle uniform in [0, max_angle].
/// @param max_angle radians @param include_root false leaves joint 0 alone
JointTurns draw_turns(std::size_t joints, double probability, double max_angle, bool include_root, Rng& rng);

/// Joint → world after the turns, [J], from the bind pose:
///   G_root = R_root, g_root = J_root; G_k = G_p R_k, g_k = g_p + G_p (J_k − J_p); world_k = [G_k | g_k − G_k J_k]
///   bind_k
/// so that skinning with world_k · bind_k⁻¹ gives the reference's Σ_k w (G_k v + g_k − G_k J_k), and scale or shear of
/// a joint's frame stays as it is.
std::vector<Eigen::Matrix4d> turned_joints(const Skeleton& skeleton, const JointTurns& turns);

}  // namespace anigen::prepare
