#include "anigen/models/anymate/checks.h"

#include "anigen/core/error.h"
#include "anigen/nn/shape_text.h"

namespace anigen::models::anymate {

void require(bool condition, const std::string& what, const std::string& problem) {
  if (!condition) throw InputError("", what, problem);
}

void require_shape(const Tensor& tensor, const std::vector<std::int64_t>& shape, const std::string& what) {
  bool fits = tensor.defined() && tensor.dim() == static_cast<std::int64_t>(shape.size());
  for (std::size_t axis = 0; fits && axis < shape.size(); ++axis) {
    fits = shape[axis] < 0 || tensor.size(static_cast<std::int64_t>(axis)) == shape[axis];
  }
  if (fits) return;
  throw InputError("", what, "has shape " + nn::shape_text(tensor) + ", not " + nn::shape_text(shape) + " (-1: any)");
}

}  // namespace anigen::models::anymate
