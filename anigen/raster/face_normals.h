#pragma once
#include "anigen/nn/torch.h"

namespace anigen::raster {

using torch::Tensor;

/// Unit normals (v₁ − v₀) × (v₂ − v₀) of the faces, counter-clockwise outside; (almost) zero for faces whose doubled
/// area is below 1e-12, which also pass no gradient on. Differentiable once; same gradients for any number of threads.
/// @param vertices [V, 3] fp32 or fp64 @param faces [F, 3] int64 @return [F, 3]
/// @throws InputError when shapes, types or indices do not fit
Tensor face_normals(const Tensor& vertices, const Tensor& faces);

}  // namespace anigen::raster
