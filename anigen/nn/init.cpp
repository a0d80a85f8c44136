#include "anigen/nn/init.h"

#include "anigen/nn/linear.h"

namespace anigen::nn {
namespace {

template <typename LinearType>
void xavier_uniform(LinearType& linear) {
  torch::nn::init::xavier_uniform_(linear.weight);
  if (linear.bias.defined()) torch::nn::init::zeros_(linear.bias);
}

}  // namespace

void xavier_uniform_linears(torch::nn::Module& module) {
  module.apply([](torch::nn::Module& part) {
    if (auto* linear = part.as<LinearImpl>()) xavier_uniform(*linear);
    if (auto* linear = part.as<torch::nn::LinearImpl>()) xavier_uniform(*linear);
  });
}

bool is_linear_or_convolution(const torch::nn::Module& module) {
  return module.as<LinearImpl>() != nullptr || module.as<torch::nn::LinearImpl>() != nullptr ||
         module.as<torch::nn::Conv1dImpl>() != nullptr || module.as<torch::nn::Conv2dImpl>() != nullptr ||
         module.as<torch::nn::Conv3dImpl>() != nullptr;
}

void cast_linears(torch::nn::Module& module, torch::Dtype dtype) {
  module.apply([dtype](torch::nn::Module& part) {
    if (!is_linear_or_convolution(part)) return;
    for (Tensor& parameter : part.parameters(/*recurse=*/false)) parameter.set_data(parameter.data().to(dtype));
  });
}

}  // namespace anigen::nn
