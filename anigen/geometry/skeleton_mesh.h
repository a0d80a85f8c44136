#pragma once
#include <Eigen/Core>
#include <vector>

#include "anigen/asset/asset.h"
#include "anigen/asset/mesh.h"
#include "anigen/asset/skin_weights.h"

namespace anigen::geometry {

struct SkeletonMesh {
  Mesh mesh;         ///< with vertex colours, no normals
  SkinWeights skin;  ///< one row per vertex: spheres move with their joint, cones with the parent that they start at
};

/// A skeleton as a solid: the geometry of the published skeleton.glb (reference flows-and-pipeline.md, 5.11). A sphere
/// of radius 0.02 L per joint in sand (230, 180, 80), a cone from 0.01 L at the parent to a point at the child per bone
/// in steel blue (160, 180, 200), L the diagonal of the box around the joints, 1 where that is below 1e-5; bones
/// shorter than 1e-5 have no cone. Colours are those numbers over 255, as the published file has them.
/// @param joints,parents [J], same frame; -1 for a root
/// @throws InputError without joints, when lengths differ, a parent is out of range or a position is not finite
SkeletonMesh skeleton_mesh(const std::vector<Eigen::Vector3d>& joints, const std::vector<int>& parents);

/// That solid, bound to its skeleton. @throws InputError as skeleton_mesh()
Asset skeleton_asset(const Skeleton& skeleton);

}  // namespace anigen::geometry
