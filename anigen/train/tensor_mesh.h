#pragma once
#include "anigen/asset/asset.h"
#include "anigen/nn/torch.h"

namespace anigen::train {

/// @param vertices [V, 3] @param faces [F, 3] integers, anywhere
Mesh mesh_of(const torch::Tensor& vertices, const torch::Tensor& faces);

/// Rows as points, [N, 3]. In double for geometry, world frame.
std::vector<Eigen::Vector3d> joint_positions(const torch::Tensor& joints);
std::vector<int> joint_parents(const torch::Tensor& parents);

/// @param dense [V, J], rows need not sum to 1
SkinWeights skin_of(const torch::Tensor& dense);

}  // namespace anigen::train
