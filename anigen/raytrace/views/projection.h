#pragma once
#include <Eigen/Core>
#include <vector>

namespace anigen::raytrace {

// Cameras in OpenCV's form: x right, y down, z forward; pictures as uv in [0, 1]², origin top left, so that intrinsics
// do not depend on the resolution. (Reference training-and-data.md, 1.1.)

/// World-to-camera [4,4] of a camera-to-world in Blender's form: the inverse after columns 1 and 2 (up, back) have
/// changed sign. @throws InputError when the matrix has no inverse
Eigen::Matrix4d extrinsics_of(const Eigen::Matrix4d& camera_to_world);

/// Normalised intrinsics [3,3] of a field of view (radians) that holds for both axes:
/// fx = fy = 0.5 / tan(fov / 2), cx = cy = 0.5. @throws InputError unless 0 < fov < π
Eigen::Matrix3d intrinsics_of(double fov);

/// (u, v, depth) of a world point, depth along the optical axis. The plain quotient: u and v mean nothing where
/// depth ≤ 0.
Eigen::Vector3d project(const Eigen::Vector3d& point, const Eigen::Matrix4d& extrinsics,
                        const Eigen::Matrix3d& intrinsics);

/// The world point that project() maps to (u, v, depth).
Eigen::Vector3d unproject(const Eigen::Vector3d& uv_depth, const Eigen::Matrix4d& extrinsics,
                          const Eigen::Matrix3d& intrinsics);

/// Clip-space projection [4,4] for OpenCV camera space: z / w is 0 at depth `near` and 1 at `far`, y is not flipped,
/// so row 0 of what is rasterised with it is the top. Entry (1, 2) is 1 − 2 cy as published, which is right only for
/// cy = 0.5. (Parity notes, "Differentiable rasterisation rules".) @throws InputError unless 0 < near < far
Eigen::Matrix4d clip_projection(const Eigen::Matrix3d& intrinsics, double near, double far);

/// uv of all pixel centres, row by row from the top, [height · width].
std::vector<Eigen::Vector2d> image_uv(int width, int height);

}  // namespace anigen::raytrace
