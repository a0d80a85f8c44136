#pragma once
#include "anigen/models/rignet/joint_clusters.h"
#include "anigen/models/rignet/model.h"
#include "anigen/models/rignet/skeleton_tree.h"

namespace anigen::models::rignet {

/// How a model's joints are read off: with its own bandwidth and symmetry.
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

}  // namespace anigen::models::rignet
