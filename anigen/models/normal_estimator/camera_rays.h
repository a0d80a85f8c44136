#pragma once
#include "anigen/nn/torch.h"

namespace anigen::models {

using torch::Tensor;

/// A pinhole camera, in pixels. The centre of the pixel in row i and column j is (j + 0.5, i + 0.5); X points right, Y
/// down, Z into the picture.
struct PinholeCamera {
  double focal_u = 0.0, focal_v = 0.0;
  double center_u = 0.0, center_v = 0.0;

  /// 60° across the longer side, looking through the middle (reference normal-estimator.md, 3, steps 4 and 5).
  static PinholeCamera of_picture(std::int64_t height, std::int64_t width);
  /// The camera of the picture with so many columns added at its left and rows at its top.
  PinholeCamera padded(std::int64_t left, std::int64_t top) const;
  /// The camera of the picture reduced to 1 / factor of its height and width.
  PinholeCamera reduced(std::int64_t factor) const;

  /// (focal_u, focal_v) and (center_u, center_v) as [1, 2, 1, 1], dtype and device of `like`.
  Tensor focal(const Tensor& like) const;
  Tensor center(const Tensor& like) const;
};

/// v / max(‖v‖, 1e-12) over axis 1.
Tensor unit_vectors(const Tensor& v);

/// Where pixels lie, (j + 0.5, i + 0.5). @return [1, 2, rows, columns], dtype and device of `like`
Tensor pixel_centers(std::int64_t rows, std::int64_t columns, const Tensor& like);

/// The rays through pixels, as (x / z, y / z). @return [1, 2, rows, columns], dtype and device of `like`
Tensor ray_slopes(const PinholeCamera& camera, std::int64_t rows, std::int64_t columns, const Tensor& like);

/// Unit vectors along the rays. @param slopes [1, 2, H, W] @return [1, 3, H, W]
Tensor unit_rays(const Tensor& slopes);

/// The ray ReLU of DSINE (Bae and Davison 2024, "Rethinking Inductive Biases for Surface Normal Estimation", section 3;
/// reference normal-estimator.md, 6): what is seen faces the camera, so the component of a normal along the ray, with
/// normals pointing away from the camera, is raised to at least 0.01, and the normal made unit again.
/// @param normals [B, 3, ...] @param rays unit, broadcast to the same shape
Tensor ray_relu(const Tensor& normals, const Tensor& rays);

}  // namespace anigen::models
