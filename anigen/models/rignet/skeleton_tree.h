#pragma once
#include <Eigen/Core>
#include <vector>

namespace anigen::models::rignet {

/// What RigNet knows of the joints of one mesh, in its frame.
struct JointGraph {
  std::vector<Eigen::Vector3d> joints;  ///< [J], J ≥ 1
  Eigen::MatrixXd bone;                 ///< [J, J] probabilities, symmetric
  Eigen::VectorXd root;                 ///< [J] probabilities
  Eigen::MatrixXd outside;              ///< [J, J] samples of the segment between two joints that are outside the mesh
};

/// Parents of a tree through all joints: from the likeliest root (the first of equal ones) Prim's algorithm takes the
/// cheapest edge at a time, an edge costing −ln(p + 1e-10), or twice the number of samples outside where that is above
/// one, and half of it between joints within 0.02 of x = 0 (reference anymate-baselines.md, 9.3).
///
/// Where the joints are mirror images of each other, as clustered_joints() makes them, so is the tree: a root beside
/// the middle gives way to the nearest joint of the middle, and a joint of the side x > 0 brings its twin along, whose
/// parent is the twin of its own. Joints that are not, or of which none lies in the middle, are taken one at a time.
/// @return [J], -1 for the root @throws InputError for shapes or numbers that are not finite
std::vector<int> skeleton_tree(const JointGraph& graph);

}  // namespace anigen::models::rignet
