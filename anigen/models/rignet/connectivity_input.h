#pragma once
#include <vector>

#include "anigen/models/rignet/mesh_graph.h"
#include "anigen/models/rignet/point_sets.h"

namespace anigen::models::rignet {

/// What BoneNet and RootNet look at: meshes, their joints, and every pair of joints of one mesh. RigNet's frame.
struct ConnectivityInput {
  MeshGraph graph;
  PointSets joints;
  Tensor first, second;  ///< [P] int64 rows of joints, first < second
  Tensor inside;         ///< [P] the share of the segment between them that is inside the mesh
};

/// All pairs of each mesh. @param graphs one mesh each @param joints [J, 3], J ≥ 1 @param inside [J, J], symmetric
/// @throws InputError for shapes
ConnectivityInput connectivity_input(const std::vector<MeshGraph>& graphs, const std::vector<Tensor>& joints,
                                     const std::vector<Tensor>& inside, torch::Device device = torch::kCPU);

/// The truth for the same pairs and joints, 0 or 1.
struct ConnectivityTruth {
  Tensor bone;  ///< [P]
  Tensor root;  ///< [ΣJ]
};

/// @param parents [J] int64 of each mesh, its own index for a root, in the order of the input's meshes
ConnectivityTruth connectivity_truth(const std::vector<Tensor>& parents, torch::Device device = torch::kCPU);

}  // namespace anigen::models::rignet
