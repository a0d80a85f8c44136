#pragma once
#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

namespace anigen::geometry {

/// Index of a voxel of the R³ grid over the cube [-0.5, 0.5]³ of the world frame, each entry in [0, R). Voxel (i, j, k)
/// is the box [i, i+1] × [j, j+1] × [k, k+1] of edge 1/R, counted from the corner (-0.5, -0.5, -0.5). Sets of voxels
/// are vectors in lexicographic (x, y, z) order without repetition, unless a function says otherwise.
using Voxel = std::array<std::int32_t, 3>;

/// Largest resolution: a set of voxels is worked on as one bit each, 128 MiB at this resolution.
constexpr int kMaxVoxelResolution = 1024;

/// @throws InputError unless 1 ≤ resolution ≤ kMaxVoxelResolution
void require_resolution(int resolution);
/// @throws InputError naming the first voxel outside the grid, or a bad resolution
void require_inside(const std::vector<Voxel>& voxels, int resolution);

/// (i + 0.5) / R − 0.5, what the published voxel files hold (reference training-and-data.md, 1.1).
Eigen::Vector3d voxel_center(const Voxel& voxel, int resolution);

/// The voxel that a reader of voxel files makes of a point: (p + 0.5) · R truncated toward zero, so that points less
/// than one voxel below -0.5 count as 0 (reference training-and-data.md, 1.1).
/// @throws InputError when the point is not finite or its voxel lies outside the grid
Voxel voxel_at(const Eigen::Vector3d& point, int resolution);

/// The points p + (±1, ±1, ±1) · 0.25/R around a voxel's centre, z changing fastest and − first: where the encoder
/// looks up skin features (reference autoencoders.md, 3.3).
std::array<Eigen::Vector3d, 8> sub_voxel_points(const Voxel& voxel, int resolution);

/// Puts a list into the order of a set and removes repetitions.
void sort_unique(std::vector<Voxel>& voxels);

/// Every voxel within Chebyshev distance `radius` of the set: one pass of a cube of side 2·radius + 1, clipped by the
/// grid (reference training-and-data.md, 1.4). Radius 0 returns the set. @param voxels in any order
/// @throws InputError on a negative radius, a bad resolution, or a voxel outside the grid
std::vector<Voxel> dilate(const std::vector<Voxel>& voxels, int resolution, int radius);

/// The random dilation of reference training-and-data.md, 1.4: each voxel takes its state from the set dilated by
/// radius − 1 (nothing at all when radius ≤ 1) or from the set dilated by radius + 1, with probability ½ each.
/// @param draw uniform in [0, 1); called once for every voxel in which the two differ, in lexicographic order; below ½
///        the smaller dilation decides @throws InputError as dilate
std::vector<Voxel> dilate_randomly(const std::vector<Voxel>& voxels, int resolution, int radius,
                                   const std::function<double()>& draw);

}  // namespace anigen::geometry
