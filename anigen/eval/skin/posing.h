#pragma once
#include <Eigen/Core>
#include <vector>

#include "anigen/asset/skin_weights.h"
#include "anigen/io/rigs/joint_tree.h"
#include "anigen/io/rigs/rigged_shape.h"

namespace anigen::eval {

// Posing of rigs that are joints and weights only: no axes of joints, any order, forests too.

/// x ↦ turn · x + shift: what a joint does to the vertices that it moves.
struct RigidMotion {
  Eigen::Matrix3d turn = Eigen::Matrix3d::Identity();
  Eigen::Vector3d shift = Eigen::Vector3d::Zero();

  Eigen::Vector3d operator()(const Eigen::Vector3d& x) const { return turn * x + shift; }
};

/// Every joint, none before its parent.
std::vector<int> parents_first(const io::JointTree& tree);

/// Rest to posed when the joints have these orientations in the world (identity at rest): roots stay in place,
/// x_j = x_parent + R_parent (rest_j − rest_parent). @param order parents_first(tree)
std::vector<RigidMotion> rigid_motions(const io::JointTree& tree, const std::vector<int>& order,
                                       const std::vector<Eigen::Matrix3d>& orientations);

/// Linear blend skinning of one vertex with row v of the weights; an empty row counts as weight 1 on joint 0.
Eigen::Vector3d skinned(const Eigen::Vector3d& vertex, const SkinWeights& skin, std::size_t v,
                        const std::vector<RigidMotion>& joints);

/// The shape's own vertices moved by its own weights. @pre shape.has_skin()
std::vector<Eigen::Vector3f> posed_vertices(const io::RiggedShape& shape, const std::vector<RigidMotion>& joints);

}  // namespace anigen::eval
