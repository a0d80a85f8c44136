#pragma once
#include <Eigen/Core>
#include <vector>

#include "anigen/nn/torch.h"
#include "anigen/rignet/model.h"

namespace anigen::rignet {

/// One step of mean shift, all points at once and among themselves, under the Epanechnikov kernel
/// k_ij = max(h² − ‖p_i − p_j‖², 0) · a_j: p_i moves by `step` of the way to Σ_j k_ij p_j / Σ_j k_ij
/// (docs/reference/rignet.md, 3, which weighs by a_i: taken as the attention of the point that is weighed). A point
/// that nothing within reach attends to stays. Differentiable in all three.
/// @param points [N, 3] @param attention [N], not negative @param bandwidth scalar h > 0 @return [N, 3]
/// @throws InputError for shapes
Tensor mean_shifted(const Tensor& points, const Tensor& attention, const Tensor& bandwidth, double step = 0.3);

/// Clustering of displaced vertices into joints; defaults are published (docs/reference/rignet.md, 3).
struct JointClusters {
  double bandwidth = 0.04;        ///< in units of the longest side
  double least_attention = 1e-3;  ///< vertices must attend by more
  double least_density = 1e-5;    ///< of a place, in shares of the sum over all places
  std::int64_t most_shifts = 40;
  double least_movement = 1e-3;  ///< of all points together: less is the end
  bool mirrored = true;          ///< points count on both sides of x = 0, and so do joints
  double middle = 0.02;          ///< joints this near to x = 0 lie on it, when mirrored
};

/// Joints of one mesh: displaced vertices inside it that attend enough, and their mirror images, go to where they are
/// densest (mean_shifted, whole steps, as training's damped ones end there too); of places within a bandwidth only the
/// densest stays. Mirrored, those near the middle go onto it and those on the side x > 0 get a twin. While fewer than
/// two joints are left and there are sparser places, the least density goes down by a factor of 1.3. Where no displaced
/// vertex is inside, all count; where none attends, all of those left.
/// @param points [V, 3] @param attention [V] in [0, 1] @param inside [V] bool: whether a displaced vertex is inside
/// @return [J, 3] fp32 on the CPU, at least one @throws InputError for shapes, without points or not finite
Tensor clustered_joints(const Tensor& points, const Tensor& attention, const Tensor& inside,
                        const JointClusters& options = {});

/// RigNet's prediction of the joints of one mesh, in its frame.
struct JointGraph {
  std::vector<Eigen::Vector3d> joints;  ///< [J], J ≥ 1
  Eigen::MatrixXd bone;                 ///< [J, J] probabilities, symmetric
  Eigen::VectorXd root;                 ///< [J] probabilities
  Eigen::MatrixXd outside;              ///< [J, J] samples of the segment between two joints that are outside the mesh
};

/// Parents of a tree through all joints: from the likeliest root (the first of equal ones) Prim's algorithm takes the
/// cheapest edge at a time, an edge costing −ln(p + 1e-10), or twice the number of samples outside where that is above
/// one, and half of it between joints within 0.02 of x = 0 (docs/reference/rignet.md, 4).
///
/// If the joints are mirror images of each other, as clustered_joints() makes them, so is the tree: a root beside
/// the middle gives way to the nearest joint of the middle, and a joint of the side x > 0 brings its twin along, whose
/// parent is the twin of its own. Joints that are not, or of which none lies in the middle, are taken one at a time.
/// @return [J], -1 for the root @throws InputError for shapes or numbers that are not finite
std::vector<int> skeleton_tree(const JointGraph& graph);

/// Clustering options of a model's joints: with its own bandwidth and symmetry.
JointClusters clusters_of(RignetModelImpl& model);

/// Tree and probabilities of one mesh. No gradient is recorded.
struct PredictedTree {
  JointGraph graph;
  std::vector<int> parents;  ///< [J], -1 for the root
};
/// @param input of one mesh, on the model's device @param outside [J, J] samples outside, SolidShape::ways
/// @throws InputError for a model of another task, or probabilities that are not finite
PredictedTree predicted_tree(RignetModelImpl& model, const ConnectivityInput& input, const Tensor& outside);

/// Weights of all bones at the vertices of one mesh: the softmax over its slots, scattered. No gradient is recorded.
/// @param bones how many there are @return [V, bones] fp32 on the CPU @throws InputError for a model of another task
Tensor predicted_weights(RignetModelImpl& model, const MeshGraph& graph, const BoneSlots& slots, std::int64_t bones);

}  // namespace anigen::rignet
