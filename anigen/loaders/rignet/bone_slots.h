#pragma once
#include <Eigen/Core>
#include <vector>

#include "anigen/loaders/rignet/surface_paths.h"
#include "anigen/models/rignet/skin_network.h"

namespace anigen::loaders {

/// Bones of a rig in RigNet's frame.
struct BoneEnds {
  std::vector<Eigen::Vector3d> heads, tails;  ///< [K]
};

/// Volumetric geodesic distances from every vertex to every bone (reference anymate-baselines.md, 9.3). A vertex sees a
/// bone when the ray from the bone's nearest point meets the surface first at the vertex, within 1e-4; it is then as
/// far as that ray is long. Any other, and those that see it from farther than 1.3 times the 15th percentile of who
/// does, are as far as the nearest vertex that sees it, along the surface, and that one from the bone; 8 and the
/// straight distance where no way leads there. @return [V][K] row by row, in units of the longest side
std::vector<double> volumetric_distances(const RignetMesh& mesh, const SurfacePaths& paths, const BoneEnds& bones);

/// The nearest `slots` bones of every vertex by those distances, with what SkinNet is told of each: head, tail, 1/D (D
/// at least 0.01, since a bone on the surface would drown everything else) and 1 for a bone at whose tail no other
/// begins. The published skeletons have a bone without length at each leaf joint instead; our bones of leaves have one.
/// @param distances of volumetric_distances @param slots at least 1
models::rignet::BoneSlots bone_slots(const std::vector<double>& distances, const BoneEnds& bones, std::int64_t slots);

}  // namespace anigen::loaders
