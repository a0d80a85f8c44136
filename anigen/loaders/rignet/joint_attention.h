#pragma once
#include <vector>

#include "anigen/loaders/rignet/rignet_mesh.h"
#include "anigen/nn/torch.h"

namespace anigen::loaders {

/// Which vertices MaskNet is to attend to (reference anymate-baselines.md, 9.3): 14 rays go from either end of each
/// bone at right angles to it; of an end's hits those nearer than twice their 20th percentile count, and vertices
/// within 0.02 of one attend. Where a joint gets fewer than six this way, the six nearest to the joint do as well (the
/// reference does not say which).
/// @param joints [J] RigNet's frame @param parents [J], its own index for a root @return [V] fp32, 0 or 1
torch::Tensor joint_attention(const RignetMesh& mesh, const std::vector<Eigen::Vector3d>& joints,
                              const std::vector<int>& parents);

}  // namespace anigen::loaders
