#include "anigen/raster/check_inputs.h"

#include <limits>

#include "anigen/core/error.h"
#include "anigen/nn/shape_text.h"

namespace anigen::raster {

void check_real(const Tensor& tensor, std::int64_t dimensions, const std::string& name) {
  if (!tensor.defined() || tensor.dim() != dimensions) {
    throw InputError("", name,
                     "needs " + std::to_string(dimensions) + " dimensions, its shape is " + nn::shape_text(tensor));
  }
  if (nn::dtype_of(tensor) != torch::kFloat32 && nn::dtype_of(tensor) != torch::kFloat64) {
    throw InputError("", name, "must be fp32 or fp64");
  }
}

void check_clip(const Tensor& clip) {
  check_real(clip, 2, "clip");
  if (clip.size(1) != 4) throw InputError("", "clip", "must be [V, 4], is " + nn::shape_text(clip));
}

Tensor checked_faces(const Tensor& faces, std::int64_t vertices, const std::string& name) {
  if (!faces.defined() || faces.dim() != 2 || faces.size(1) != 3 || nn::dtype_of(faces) != torch::kInt64) {
    throw InputError("", name, "must be int64 [F, 3], the shape is " + nn::shape_text(faces));
  }
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
  if (!triangle.defined() || triangle.dim() != 2 || nn::dtype_of(triangle) != torch::kInt64) {
    throw InputError("", "triangle", "must be int64 [H, W], the shape is " + nn::shape_text(triangle));
  }
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

}  // namespace anigen::raster
