#include "anigen/models/half_precision.h"

#include "anigen/nn/init.h"
#include "anigen/sparse/convolution.h"

namespace anigen::models {

bool converts_to_half(const torch::nn::Module& module) {
  return nn::is_linear_or_convolution(module) || module.as<sparse::SubmanifoldKernelImpl>() != nullptr;
}

void cast_torso(torch::nn::Module& module, torch::Dtype dtype) {
  module.apply([dtype](torch::nn::Module& part) {
    if (!converts_to_half(part)) return;
    for (torch::Tensor& parameter : part.parameters(/*recurse=*/false)) {
      parameter.set_data(parameter.data().to(dtype));
    }
  });
}

}  // namespace anigen::models
