#pragma once
#include <string>

#include "anigen/nn/torch.h"

namespace anigen::raster {

using torch::Tensor;

/// @throws InputError unless the tensor is fp32 or fp64 [rows, columns…] of that many dimensions
void check_real(const Tensor& tensor, std::int64_t dimensions, const std::string& name);

/// @throws InputError unless [V, 4], fp32 or fp64
void check_clip(const Tensor& clip);

/// The faces on the CPU, contiguous. @throws InputError unless int64 [F, 3] with indices below `vertices`
Tensor checked_faces(const Tensor& faces, std::int64_t vertices, const std::string& name);

/// The triangles of a picture on the CPU, contiguous.
/// @throws InputError unless int64 [H, W] with values of 0 … faces
Tensor checked_triangles(const Tensor& triangle, std::int64_t faces);

}  // namespace anigen::raster
