#pragma once
#include "anigen/nn/torch.h"

namespace anigen::raster {

using torch::Tensor;

/// What every pixel shows. Row 0 is y/w = −1. Differentiable: gradients of `barycentric` reach x, y, w of the vertices.
struct Fragments {
  Tensor barycentric;  ///< [H, W, 2]: u, v of the first and second corner, perspective correct; 0 for background
  Tensor depth;        ///< [H, W]: z/w in [-1, 1]; no gradient
  Tensor triangle;     ///< [H, W] int64: triangle + 1, 0 for background
};

/// Visibility of the nearest surface per pixel centre; no culling; triangles that reach behind the camera show as far
/// as they are in front of it. Positions are snapped to 1/2^subpixel_bits pixel for coverage only; the published system
/// has 1/16 pixel, finer steps come closer to exact coverage. Barycentrics are of the unsnapped triangle, clamped to
/// it; gradients pass the clamp. Runs on all threads of the CPU, with the same result for any number; tensors of other
/// devices are copied there and back. Can be differentiated once (reference README-ops.md, rasterisation rules).
/// @param clip [V, 4] fp32 or fp64 @param faces [F, 3] int64
/// @throws InputError on a bad index or size, and on a vertex that is not finite
Fragments rasterize(const Tensor& clip, const Tensor& faces, std::int64_t height, std::int64_t width,
                    std::int64_t subpixel_bits = 4);

/// u a₀ + v a₁ + (1−u−v) a₂ per pixel, 0 for background; differentiable in attributes and barycentric.
/// @param attributes [V', C] fp32 or fp64 @param faces [F, 3] int64 into attributes @return [H, W, C]
/// @throws InputError when shapes, types or indices do not fit
Tensor interpolate(const Tensor& attributes, const Fragments& fragments, const Tensor& faces);

}  // namespace anigen::raster
