#include "anigen/raster/mesh_renderer.h"

#include <cmath>
#include <limits>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/nn/init.h"
#include "anigen/raster/antialias.h"
#include "anigen/raster/interpolate.h"

namespace anigen::raster {

namespace {

void check_square(const Tensor& matrix, std::int64_t size, const std::string& name) {
  check_real(matrix, 2, name);
  if (matrix.size(0) != size || matrix.size(1) != size) {
    const std::string side = std::to_string(size);
    throw InputError("", name, "must be [" + side + ", " + side + "], is " + nn::shape_text(matrix));
  }
}

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

Tensor projection_matrix(const Tensor& intrinsics, double near, double far) {
  check_square(intrinsics, 3, "intrinsics");
  if (!(near > 0.0 && far > near && std::isfinite(far)))
    throw InputError("", "near, far", "must be finite with 0 < near < far");
  const auto entry = [&](std::int64_t row, std::int64_t column) { return intrinsics.select(0, row).select(0, column); };
  const Tensor zero = torch::zeros({}, intrinsics.options()), one = torch::ones({}, intrinsics.options());
  return torch::stack({2.0 * entry(0, 0), zero, 2.0 * entry(0, 2) - 1.0, zero,                     //
                       zero, 2.0 * entry(1, 1), 1.0 - 2.0 * entry(1, 2), zero,                     //
                       zero, zero, one * (far / (far - near)), one * (near * far / (near - far)),  //
                       zero, zero, one, zero})
      .view({4, 4});
}

Tensor to_clip(const Tensor& vertices, const Tensor& extrinsics, const Tensor& projection) {
  check_real(vertices, 2, "vertices");
  if (vertices.size(1) != 3) throw InputError("", "vertices", "must be [V, 3], is " + nn::shape_text(vertices));
  check_square(extrinsics, 4, "extrinsics");
  check_square(projection, 4, "projection");
  if (nn::dtype_of(extrinsics) != nn::dtype_of(vertices) || nn::dtype_of(projection) != nn::dtype_of(vertices))
    throw InputError("", "extrinsics, intrinsics", "must be of the vertices' type");
  const Tensor camera =
      vertices.matmul(extrinsics.narrow(0, 0, 3).narrow(1, 0, 3).t()) + extrinsics.narrow(0, 0, 3).select(1, 3);
  return camera.matmul(projection.narrow(1, 0, 3).t()) + projection.select(1, 3);
}

void check_real(const Tensor& tensor, std::int64_t dimensions, const std::string& name) {
  if (!tensor.defined() || tensor.dim() != dimensions) {
    throw InputError("", name,
                     "needs " + std::to_string(dimensions) + " dimensions, its shape is " + nn::shape_text(tensor));
  }
  if (nn::dtype_of(tensor) != torch::kFloat32 && nn::dtype_of(tensor) != torch::kFloat64)
    throw InputError("", name, "must be fp32 or fp64");
}

void check_clip(const Tensor& clip) {
  check_real(clip, 2, "clip");
  if (clip.size(1) != 4) throw InputError("", "clip", "must be [V, 4], is " + nn::shape_text(clip));
}

Tensor checked_faces(const Tensor& faces, std::int64_t vertices, const std::string& name) {
  if (!faces.defined() || faces.dim() != 2 || faces.size(1) != 3 || nn::dtype_of(faces) != torch::kInt64)
    throw InputError("", name, "must be int64 [F, 3], the shape is " + nn::shape_text(faces));
  if (faces.size(0) >= std::numeric_limits<std::int32_t>::max() ||
      vertices >= std::numeric_limits<std::int32_t>::max()) {
    throw InputError("", name, "more triangles or vertices than 32 bits can count");
  }
  const Tensor host = faces.to(torch::kCPU).contiguous();
  const std::int64_t* index = host.data_ptr<std::int64_t>();
  for (std::int64_t i = 0; i < host.numel(); ++i) {
    if (index[i] < 0 || index[i] >= vertices) {
      throw InputError("", name + ", triangle " + std::to_string(i / 3),
                       "vertex " + std::to_string(index[i]) + " of " + std::to_string(vertices));
    }
  }
  return host;
}

Tensor checked_triangles(const Tensor& triangle, std::int64_t faces) {
  if (!triangle.defined() || triangle.dim() != 2 || nn::dtype_of(triangle) != torch::kInt64)
    throw InputError("", "triangle", "must be int64 [H, W], the shape is " + nn::shape_text(triangle));
  const Tensor host = triangle.to(torch::kCPU).contiguous();
  const std::int64_t* id = host.data_ptr<std::int64_t>();
  for (std::int64_t i = 0; i < host.numel(); ++i) {
    if (id[i] < 0 || id[i] > faces) {
      throw InputError("", "pixel " + std::to_string(i),
                       "shows triangle " + std::to_string(id[i]) + " of " + std::to_string(faces) +
                           ": the picture was made with other faces");
    }
  }
  return host;
}

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
