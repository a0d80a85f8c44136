#include "anigen/models/half_precision.h"

#include "anigen/nn/init.h"
#include "anigen/sparse/convolution.h"

namespace anigen::models {

bool converts_to_half(const torch::nn::Module& module) {
  return nn::is_linear_or_convolution(module) || module.as<sparse::SubmanifoldKernelImpl>() != nullptr;
}

void cast_torso(torch::nn::Module& module, torch::Dtype dtype) {
  nn::cast_linears(module, dtype);
  sparse::cast_submanifold_kernels(module, dtype);
}

}  // namespace anigen::models
