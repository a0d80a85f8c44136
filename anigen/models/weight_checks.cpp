#include "anigen/models/weight_checks.h"

#include "anigen/core/error.h"
#include "anigen/models/tensor_arrays.h"

namespace anigen::models {

bool is_floating_point(io::Dtype dtype) {
  return dtype == io::Dtype::kF16 || dtype == io::Dtype::kBF16 || dtype == io::Dtype::kF32 || dtype == io::Dtype::kF64;
}

void check_weight_values(const io::NamedArrays& arrays, const std::string& file) {
  for (const auto& [key, array] : arrays) {
    if (!is_floating_point(array.dtype)) {
      throw InputError(file, key, std::string("floating-point weights expected, found ") + io::name_of(array.dtype));
    }
    if (!to_tensor(array).isfinite().all().item<bool>()) {
      throw InputError(file, key, "holds values that are not finite; fetch the weights again");
    }
  }
}

}  // namespace anigen::models
