#pragma once
#include <Eigen/Core>
#include <vector>

#include "anigen/asset/mesh.h"
#include "anigen/asset/rigged_asset.h"
#include "anigen/asset/skin_weights.h"

namespace anigen::geometry {

/// A closed sphere around the origin: an icosahedron whose triangles are cut in four `subdivisions` times, with all
/// vertices on the sphere. 20 · 4ⁿ faces, counter-clockwise from outside.
/// @throws InputError unless 0 ≤ subdivisions ≤ 8
Mesh icosphere(int subdivisions, double radius);

/// A closed cone with a round base of `sections` corners around `base`, its axis towards `apex`.
/// 2 · sections faces, counter-clockwise from outside.
/// @throws InputError with fewer than 3 sections, or when base and apex are the same
Mesh cone(const Eigen::Vector3d& base, const Eigen::Vector3d& apex, double radius, int sections);

struct SkeletonMesh {
  Mesh mesh;         ///< with vertex colours, no normals
  SkinWeights skin;  ///< one row per vertex: spheres move with their joint, cones with the parent that they start at
};

/// A skeleton as a solid: the geometry of the published skeleton.glb (docs/reference/flows.md, 5.9). A sphere of radius
/// 0.02 L per joint in sand (230, 180, 80), a cone from 0.01 L at the parent to a point at the child per bone in steel
/// blue (160, 180, 200), L the diagonal of the box around the joints, 1 where that is below 1e-5; bones shorter than
/// 1e-5 have no cone. Colours are those numbers over 255, as the published file has them.
/// @param joints,parents [J], same frame; -1 for a root
/// @throws InputError without joints, when lengths differ, a parent is out of range or a position is not finite
SkeletonMesh skeleton_mesh(const std::vector<Eigen::Vector3d>& joints, const std::vector<int>& parents);

/// That solid, bound to its skeleton. @throws InputError as skeleton_mesh()
Asset skeleton_asset(const Skeleton& skeleton);

}  // namespace anigen::geometry
