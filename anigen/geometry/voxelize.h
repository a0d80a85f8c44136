#pragma once
#include <Eigen/Core>
#include <vector>

#include "anigen/asset/mesh.h"
#include "anigen/geometry/voxel_grid.h"

namespace anigen::geometry {

/// What to do with a vertex outside the cube [-0.5, 0.5]³.
enum class OutsideCube {
  kClip,   ///< every coordinate of every vertex is clipped to [-0.5 + 1e-6, 0.5 − 1e-6], as published
  kRefuse  ///< InputError naming the vertex; vertices on the cube's surface stay there
};

/// The voxels whose closed box meets a triangle, surface only (reference training-and-data.md, 1.1). Exact but for the
/// rounding of vertices to 2⁻³⁰ voxel: a triangle that touches a voxel's face, edge or corner counts for it, and a
/// triangle without area counts as the segment or point it is. Runs on all threads; the result does not depend on them.
/// Memory: R³ bits, 24 bytes per vertex and the result.
/// @param vertices [V], world frame, normalised; in double precision they are not rounded to single first
/// @param resolution R, 1 to kMaxVoxelResolution
/// @return lexicographic @throws InputError on a bad resolution, a mesh without faces, a face that refers to a missing
/// vertex, or a vertex that is not finite (whether or not a face uses it)
std::vector<Voxel> voxelize_surface(const std::vector<Eigen::Vector3f>& vertices, const std::vector<Triangle>& faces,
                                    int resolution, OutsideCube outside = OutsideCube::kClip);
std::vector<Voxel> voxelize_surface(const std::vector<Eigen::Vector3d>& vertices, const std::vector<Triangle>& faces,
                                    int resolution, OutsideCube outside = OutsideCube::kClip);

/// The voxels that the bones of a skeleton pass through, and those its joints lie in; not dilated (reference
/// training-and-data.md, 1.1, skeleton file). Joints are clipped to [-0.5 + 1e-6, 0.5 − 1e-6] first.
/// @param joints [J], world frame, normalised @param parents [J], -1 for a root
/// @return lexicographic @throws InputError on a bad resolution, without joints, when lengths differ, a parent is out
/// of range, or a joint is not finite
std::vector<Voxel> voxelize_bones(const std::vector<Eigen::Vector3d>& joints, const std::vector<int>& parents,
                                  int resolution);

}  // namespace anigen::geometry
