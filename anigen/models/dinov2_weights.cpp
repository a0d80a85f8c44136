#include "anigen/models/dinov2_weights.h"

#include "anigen/core/error.h"
#include "anigen/io/torch_archive.h"
#include "anigen/models/dinov2_keys.h"
#include "anigen/models/state_dict.h"
#include "anigen/models/tensor_arrays.h"

namespace anigen::models {
namespace {

bool is_float(io::Dtype dtype) {
  return dtype == io::Dtype::kF16 || dtype == io::Dtype::kBF16 || dtype == io::Dtype::kF32 || dtype == io::Dtype::kF64;
}

void check_values(const io::NamedArrays& arrays, const std::string& file) {
  for (const auto& [key, array] : arrays) {
    if (!is_float(array.dtype)) {
      throw InputError(file, key, std::string("floating-point weights expected, found ") + io::name_of(array.dtype));
    }
    if (!to_tensor(array).isfinite().all().item<bool>()) {
      throw InputError(file, key, "holds values that are not finite; fetch the weights again");
    }
  }
}

}  // namespace

void load_dinov2_weights(Dinov2& model, const std::filesystem::path& file) {
  const io::NamedArrays arrays = to_hub_keys(io::read_state_dict(file));
  check_values(arrays, file.string());
  load_state_dict(*model, arrays, LoadMode::kStrict, file.string());
  for (const Tensor& parameter : model->parameters()) parameter.requires_grad_(false);
  model->eval();
}

}  // namespace anigen::models
