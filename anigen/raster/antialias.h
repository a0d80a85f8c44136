#pragma once
#include "anigen/raster/rasterize.h"

namespace anigen::raster {

/// Blends neighbouring pixels across silhouette edges by where the edge crosses between their centres, so that moving a
/// silhouette changes the picture continuously. Gradients reach the image and x, y, w of the vertices of those edges,
/// except where an edge passes through a centre. Several images of one view are antialiased fastest as channels of one.
/// Same result for any number of threads; differentiable once.
/// @param image [H, W, C] fp32 or fp64 @param fragments of these positions and faces @return [H, W, C]
/// (reference README-ops.md, rasterisation rules, "Antialiasing")
/// @throws InputError when shapes, types or indices do not fit
Tensor antialias(const Tensor& image, const Fragments& fragments, const Tensor& clip, const Tensor& faces);

}  // namespace anigen::raster
