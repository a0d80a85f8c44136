#pragma once
#include <Eigen/Core>
#include <vector>

#include "anigen/asset/asset.h"

namespace anigen {

/// Linear blend skinning: Σ_j w_vj · world_j · bind_j⁻¹ · v for every vertex, [V].
/// @param world joint → world of the pose, [J], from forward_kinematics
std::vector<Eigen::Vector3f> skin_vertices(const Asset& asset, const std::vector<Eigen::Matrix4d>& world);

/// The asset's mesh in a pose.
std::vector<Eigen::Vector3f> skin_vertices(const Asset& asset, const Pose& pose);

}  // namespace anigen
