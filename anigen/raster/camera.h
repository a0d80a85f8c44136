#pragma once
#include "anigen/nn/torch.h"

namespace anigen::raster {

using torch::Tensor;

/// Clip-space projection of the published mesh renderer for OpenCV camera space (x right, y down, z forward): z/w is 0
/// at depth `near` and 1 at `far`, w is the depth, y is not flipped. Entry (1, 2) is 1 − 2 cy as published, which is
/// right only for cy = 0.5 (reference README-ops.md, "Differentiable rasterisation rules").
/// @param intrinsics [3, 3] normalised, fp32 or fp64 @return [4, 4], differentiable in the intrinsics
/// @throws InputError unless 0 < near < far
Tensor projection_matrix(const Tensor& intrinsics, double near, double far);

/// @param vertices [V, 3] world @param extrinsics [4, 4] world → camera, OpenCV axes @param projection [4, 4]
/// @return clip positions [V, 4]; differentiable in all three
/// @throws InputError when shapes or types do not fit
Tensor to_clip(const Tensor& vertices, const Tensor& extrinsics, const Tensor& projection);

}  // namespace anigen::raster
