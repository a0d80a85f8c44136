#pragma once
#include "anigen/models/normal_estimator/camera_rays.h"

namespace anigen::models {

/// The (2 radius + 1)² pixels around every pixel, row by row from the upper left; beyond the border the nearest pixel
/// of the border. @param x [B, C, H, W] @return [B, C, (2 radius + 1)², H, W]
Tensor neighborhood(const Tensor& x, std::int64_t radius);

/// Axes to turn normals about: the direction in the plane perpendicular to a normal which, seen from the camera at the
/// place of the normal, points along a direction of the picture. 0 where there is none, as where the plane is seen
/// edge-on (reference normal-estimator.md, 7, step 4).
/// @param normals [B, 3, K, H, W] unit @param directions [B, 2, K, H, W] unit, pixels right and down
/// @param places [1, 2, K, H, W] where the normals are, in pixels @return [B, 3, K, H, W], unit or 0
Tensor rotation_axes(const Tensor& normals, const Tensor& directions, const Tensor& places,
                     const PinholeCamera& camera);

/// Turned by angles in radians, right-handed (Rodrigues' formula); as they are where the axis is 0.
/// @param vectors, axes [B, 3, ...] @param angles [B, 1, ...]
Tensor rotated(const Tensor& vectors, const Tensor& axes, const Tensor& angles);

/// What the refinement predicts for each of the K = 25 pixels around every pixel.
struct NeighborRotations {
  Tensor weights;     ///< [B, K, H, W], not negative; they need not sum to 1
  Tensor directions;  ///< [B, 2, K, H, W] of the axis in the picture, unit
  Tensor angles;      ///< [B, K, H, W], radians
};

/// One step of DSINE (Bae and Davison 2024, section 3; reference normal-estimator.md, 7): the normals around a pixel,
/// each turned, made to face this pixel's ray, weighted, summed and made unit.
/// @param normals [B, 3, H, W] unit @param camera of this grid @param rays [1, 3, H, W] unit
Tensor propagated_normals(const Tensor& normals, const NeighborRotations& rotations, const PinholeCamera& camera,
                          const Tensor& rays);

}  // namespace anigen::models
