#include "anigen/nn/init.h"

#include <cmath>

#include "anigen/nn/affine_layer_norm.h"
#include "anigen/nn/rms_norm.h"
#include "anigen/nn/volume_layers.h"

namespace anigen::nn {
namespace {

template <typename LinearType>
void xavier_uniform(LinearType& linear) {
  torch::nn::init::xavier_uniform_(linear.weight);
  if (linear.bias.defined()) torch::nn::init::zeros_(linear.bias);
}

void initial_lora(LinearImpl& linear) {
  if (!linear.lora_A.defined()) return;
  torch::nn::init::zeros_(linear.lora_A);
  torch::nn::init::normal_(linear.lora_B, 0.0, 0.01);
}

template <typename NormType>
void ones_and_zeros(NormType& norm) {
  torch::nn::init::ones_(norm.weight);
  torch::nn::init::zeros_(norm.bias);
}

}  // namespace

void xavier_uniform_linears(torch::nn::Module& module) {
  module.apply([](torch::nn::Module& part) {
    if (auto* linear = part.as<LinearImpl>()) {
      xavier_uniform(*linear);
      initial_lora(*linear);
    }
    if (auto* linear = part.as<torch::nn::LinearImpl>()) xavier_uniform(*linear);
  });
}

void kaiming_uniform_linears(torch::nn::Module& module) {
  module.apply([](torch::nn::Module& part) {
    auto* linear = part.as<LinearImpl>();
    if (linear == nullptr) return;
    torch::nn::init::kaiming_uniform_(linear->weight, 0.0, torch::kFanIn, torch::kLinear);
    if (linear->bias.defined()) torch::nn::init::zeros_(linear->bias);
    initial_lora(*linear);
  });
}

void default_convolutions(torch::nn::Module& module) {
  module.apply([](torch::nn::Module& part) {
    auto* convolution = part.as<Conv3dImpl>();
    if (convolution == nullptr) return;
    const Tensor& weight = convolution->weight;
    const double bound = 1.0 / std::sqrt(static_cast<double>(weight.numel() / weight.size(0)));
    torch::nn::init::uniform_(weight, -bound, bound);
    torch::nn::init::uniform_(convolution->bias, -bound, bound);
  });
}

void default_norms(torch::nn::Module& module) {
  module.apply([](torch::nn::Module& part) {
    if (auto* norm = part.as<AffineLayerNormImpl>()) ones_and_zeros(*norm);
    if (auto* norm = part.as<VolumeNormImpl>()) ones_and_zeros(*norm);
    if (auto* norm = part.as<MultiHeadRmsNormImpl>()) torch::nn::init::ones_(norm->gamma);
  });
}

void normal_linear(LinearImpl& linear, double std) {
  torch::nn::init::normal_(linear.weight, 0.0, std);
  if (linear.bias.defined()) torch::nn::init::zeros_(linear.bias);
}

void zero_parameters(torch::nn::Module& module) {
  for (const Tensor& parameter : module.parameters()) torch::nn::init::zeros_(parameter);
}

bool is_linear_or_convolution(const torch::nn::Module& module) {
  return module.as<LinearImpl>() != nullptr || module.as<torch::nn::LinearImpl>() != nullptr ||
         module.as<Conv3dImpl>() != nullptr || module.as<torch::nn::Conv1dImpl>() != nullptr ||
         module.as<torch::nn::Conv2dImpl>() != nullptr || module.as<torch::nn::Conv3dImpl>() != nullptr ||
         dynamic_cast<const Convolution*>(&module) != nullptr;
}

void cast_linears(torch::nn::Module& module, torch::Dtype dtype) {
  module.apply([dtype](torch::nn::Module& part) {
    if (!is_linear_or_convolution(part)) return;
    for (Tensor& parameter : part.parameters(/*recurse=*/false)) parameter.set_data(parameter.data().to(dtype));
  });
}

}  // namespace anigen::nn
