#pragma once
#include <ATen/Parallel.h>
#include <algorithm>
#include <atomic>
#include <cstdint>
#include <string>

#include "anigen/nn/torch.h"
#include "anigen/raster/rasterize.h"

namespace anigen::raster {

/// Clip-space projection of the published mesh renderer for OpenCV camera space (x right, y down, z forward): z/w is 0
/// at depth `near` and 1 at `far`, w is the depth, y is not flipped. Entry (1, 2) is 1 − 2 cy as published, which is
/// right only for cy = 0.5 (docs/reference/training.md, 8).
/// @param intrinsics [3, 3] normalised, fp32 or fp64 @return [4, 4], differentiable in the intrinsics
/// @throws InputError unless 0 < near < far
Tensor projection_matrix(const Tensor& intrinsics, double near, double far);

/// @param vertices [V, 3] world @param extrinsics [4, 4] world → camera, OpenCV axes @param projection [4, 4]
/// @return clip positions [V, 4]; differentiable in all three
/// @throws InputError when shapes or types do not fit
Tensor to_clip(const Tensor& vertices, const Tensor& extrinsics, const Tensor& projection);

/// @throws InputError unless the tensor is fp32 or fp64 [rows, columns…] of that many dimensions
void check_real(const Tensor& tensor, std::int64_t dimensions, const std::string& name);

/// @throws InputError unless [V, 4], fp32 or fp64
void check_clip(const Tensor& clip);

/// The faces on the CPU, contiguous. @throws InputError unless int64 [F, 3] with indices below `vertices`
Tensor checked_faces(const Tensor& faces, std::int64_t vertices, const std::string& name);

/// The triangles of a picture on the CPU, contiguous.
/// @throws InputError unless int64 [H, W] with values of 0 … faces
Tensor checked_triangles(const Tensor& triangle, std::int64_t faces);

/// Calls body(i) for i in [0, count) on all threads; each takes the next i when it is done with one, since some may
/// cost far more than others. Results must not depend on the order.
template <typename Body>
void share_out(std::int64_t count, const Body& body) {
  std::atomic<std::int64_t> next{0};
  const std::int64_t workers = std::min<std::int64_t>(at::get_num_threads(), count);
  at::parallel_for(0, workers, 1, [&](std::int64_t begin, std::int64_t end) {
    for (std::int64_t worker = begin; worker < end; ++worker) {
      for (std::int64_t i = next.fetch_add(1); i < count; i = next.fetch_add(1)) body(i);
    }
  });
}

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
/// reach the vertices, also through silhouettes (docs/reference/training.md, 8). A mesh without faces gives an empty
/// picture.
/// @param vertices [V, 3] fp32 or fp64 @param faces [F, 3] int64 @param attributes [V, A] or undefined
/// @param extrinsics [4, 4] world → camera, OpenCV axes @param intrinsics [3, 3] normalised; all of the vertices' type
/// @throws InputError when an option, shape, type or index does not fit, or a vertex is not finite
Rendering render_mesh(const Tensor& vertices, const Tensor& faces, const Tensor& attributes, const Tensor& extrinsics,
                      const Tensor& intrinsics, const RenderOptions& options);

}  // namespace anigen::raster
