#pragma once
#include "anigen/raster/rasterize.h"

namespace anigen::raster {

struct RenderOptions {
  std::int64_t resolution = 512;
  double near = 1.0, far = 3.0;    ///< depths of z/w = 0 and 1; the surface shows from near·far / (2 far − near) on
  std::int64_t ssaa = 1;           ///< renders this many times larger and reduces
  std::int64_t subpixel_bits = 4;  ///< coverage in steps of 1/2^bits pixel; 4 as published
};

struct Rendering {
  Tensor mask;        ///< [H, W] coverage
  Tensor depth;       ///< [H, W] camera z, background 0
  Tensor normal;      ///< [H, W, 3] flat face normals as (n + 1)/2, background 0.5; not turned to the camera
  Tensor attributes;  ///< [H, W, A] interpolated vertex attributes, background 0; undefined without
};

/// The published MeshRenderer: row 0 is the top of the picture; every image antialiased, so that gradients of every one
/// reach the vertices, also through silhouettes (reference README-ops.md, "Differentiable rasterisation rules"). A mesh
/// without faces gives an empty picture.
/// @param vertices [V, 3] fp32 or fp64 @param faces [F, 3] int64 @param attributes [V, A] or undefined
/// @param extrinsics [4, 4] world → camera, OpenCV axes @param intrinsics [3, 3] normalised; all of the vertices' type
/// @throws InputError when an option, shape, type or index does not fit, or a vertex is not finite
Rendering render_mesh(const Tensor& vertices, const Tensor& faces, const Tensor& attributes, const Tensor& extrinsics,
                      const Tensor& intrinsics, const RenderOptions& options);

}  // namespace anigen::raster
