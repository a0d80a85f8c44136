#include "anigen/raster/camera.h"

#include <cmath>
#include <string>

#include "anigen/core/error.h"
#include "anigen/nn/shape_text.h"
#include "anigen/raster/check_inputs.h"

namespace anigen::raster {
namespace {

void check_square(const Tensor& matrix, std::int64_t size, const std::string& name) {
  check_real(matrix, 2, name);
  if (matrix.size(0) != size || matrix.size(1) != size) {
    const std::string side = std::to_string(size);
    throw InputError("", name, "must be [" + side + ", " + side + "], is " + nn::shape_text(matrix));
  }
}

}  // namespace

Tensor projection_matrix(const Tensor& intrinsics, double near, double far) {
  check_square(intrinsics, 3, "intrinsics");
  if (!(near > 0.0 && far > near && std::isfinite(far))) {
    throw InputError("", "near, far", "must be finite with 0 < near < far");
  }
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
  if (nn::dtype_of(extrinsics) != nn::dtype_of(vertices) || nn::dtype_of(projection) != nn::dtype_of(vertices)) {
    throw InputError("", "extrinsics, intrinsics", "must be of the vertices' type");
  }
  const Tensor camera =
      vertices.matmul(extrinsics.narrow(0, 0, 3).narrow(1, 0, 3).t()) + extrinsics.narrow(0, 0, 3).select(1, 3);
  return camera.matmul(projection.narrow(1, 0, 3).t()) + projection.select(1, 3);
}

}  // namespace anigen::raster
