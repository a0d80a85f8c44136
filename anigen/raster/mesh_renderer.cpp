#include "anigen/raster/mesh_renderer.h"

#include <string>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/nn/shape_text.h"
#include "anigen/raster/antialias.h"
#include "anigen/raster/camera.h"
#include "anigen/raster/check_inputs.h"
#include "anigen/raster/face_normals.h"
#include "anigen/raster/viewport.h"

namespace anigen::raster {
namespace {

void check_options(const RenderOptions& options) {
  if (options.resolution < 1 || options.resolution > kMostPixelsPerSide) {
    throw InputError("", "resolution",
                     std::to_string(options.resolution) + " is not in 1 … " + std::to_string(kMostPixelsPerSide));
  }
  if (options.ssaa < 1 || options.ssaa > kMostPixelsPerSide / options.resolution) {
    throw InputError("", "ssaa",
                     std::to_string(options.ssaa) + " at resolution " + std::to_string(options.resolution) +
                         " is not at least 1, or makes more than " + std::to_string(kMostPixelsPerSide) +
                         " pixels per side");
  }
}

void check_attributes(const Tensor& attributes, const Tensor& vertices) {
  check_real(attributes, 2, "attributes");
  if (attributes.size(0) != vertices.size(0) || nn::dtype_of(attributes) != nn::dtype_of(vertices)) {
    throw InputError("", "attributes",
                     nn::shape_text(attributes) + " for " + std::to_string(vertices.size(0)) +
                         " vertices; must be [V, A] of the vertices' type");
  }
}

// [size, size, C] → [resolution, resolution, C]: a triangle filter as wide as the reduction.
Tensor reduced(const Tensor& image, std::int64_t resolution) {
  const Tensor planes = image.permute({2, 0, 1}).unsqueeze(0).contiguous();
  return at::_upsample_bilinear2d_aa(planes, {resolution, resolution}, /*align_corners=*/false)
      .squeeze(0)
      .permute({1, 2, 0});
}

}  // namespace

Rendering render_mesh(const Tensor& vertices, const Tensor& faces, const Tensor& attributes, const Tensor& extrinsics,
                      const Tensor& intrinsics, const RenderOptions& options) {
  check_options(options);
  const std::int64_t size = options.resolution * options.ssaa;
  const Tensor clip = to_clip(vertices, extrinsics, projection_matrix(intrinsics, options.near, options.far));
  const Fragments fragments = rasterize(clip, faces, size, size, options.subpixel_bits);

  // w is the depth. One pass of antialiasing over all channels: mask, depth, normal, attributes.
  std::vector<Tensor> of_vertices{clip.narrow(1, 3, 1)};
  if (attributes.defined()) {
    check_attributes(attributes, vertices);
    of_vertices.push_back(attributes);
  }
  const Tensor smooth = interpolate(torch::cat(of_vertices, 1), fragments, faces);
  // A flat normal is the same at all three corners, so all three name the face.
  const Tensor same =
      torch::arange(faces.size(0), faces.options()).unsqueeze(1).expand({faces.size(0), 3}).contiguous();
  const Tensor normal = interpolate(face_normals(vertices, faces), fragments, same);
  const Tensor mask = (fragments.triangle > 0).to(nn::dtype_of(vertices)).unsqueeze(2);
  const Tensor raw = torch::cat({mask, smooth.narrow(2, 0, 1), normal, smooth.narrow(2, 1, smooth.size(2) - 1)}, 2);
  Tensor image = antialias(raw, fragments, clip, faces);
  if (options.ssaa > 1) image = reduced(image, options.resolution);

  Rendering rendering;
  rendering.mask = image.select(2, 0);
  rendering.depth = image.select(2, 1);
  rendering.normal = 0.5 * (image.narrow(2, 2, 3) + 1.0);
  if (attributes.defined()) rendering.attributes = image.narrow(2, 5, image.size(2) - 5);
  return rendering;
}

}  // namespace anigen::raster
