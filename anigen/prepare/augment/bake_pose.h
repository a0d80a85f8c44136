#pragma once
#include <Eigen/Core>
#include <cstddef>
#include <optional>
#include <vector>

#include "anigen/asset/asset.h"

namespace anigen::prepare {

/// The asset in a pose, which becomes its bind pose and its rest pose: vertices by linear blend skinning, file normals
/// turned as the faces around them turned (vertices split at a seam share theirs), joint frames as given. Everything
/// else but the animations is copied; those are dropped. Not normalised.
///
/// Where frames carry scale that differs by axis, a frame relative to its parent can be sheared, which translation,
/// rotation and scale cannot say; all frames are then replaced by their rotations. Frames are free to
/// choose: the mesh is at rest in this pose.
/// @param world joint → world of the pose, [J], finite and invertible
/// @param vertices of the pose, [V]: skin_vertices(asset, world)
Asset bake_pose(const Asset& asset, const std::vector<Eigen::Matrix4d>& world, std::vector<Eigen::Vector3f> vertices);

/// The first joint whose matrix is not finite, or flat: its smallest stretch below 1e-9 of its largest. Animations hide
/// things by scaling them to nothing.
std::optional<std::size_t> collapsed_joint(const std::vector<Eigen::Matrix4d>& world);

}  // namespace anigen::prepare
