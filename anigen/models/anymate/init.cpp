#include "anigen/models/anymate/init.h"

#include <cmath>

#include "anigen/models/anymate/blocks.h"
#include "anigen/models/anymate/mini_point_net.h"

namespace anigen::models::anymate {
namespace {

void uniform_by_fan_in(Tensor weight, Tensor bias) {
  const double bound = 1.0 / std::sqrt(static_cast<double>(weight.numel() / weight.size(0)));
  torch::nn::init::uniform_(weight, -bound, bound);
  if (bias.defined()) torch::nn::init::uniform_(bias, -bound, bound);
}

}  // namespace

void default_layers(torch::nn::Module& module) {
  module.apply([](torch::nn::Module& part) {
    if (auto* linear = part.as<nn::LinearImpl>()) uniform_by_fan_in(linear->weight, linear->bias);
    if (auto* convolution = part.as<PointwiseConvImpl>()) uniform_by_fan_in(convolution->weight, convolution->bias);
  });
  nn::default_norms(module);
}

void normal_blocks(torch::nn::Module& module, double std) {
  module.apply([std](torch::nn::Module& block) {
    if (block.as<ResidualAttentionImpl>() == nullptr && block.as<ResidualCrossAttentionImpl>() == nullptr) return;
    block.apply([std](torch::nn::Module& part) {
      if (auto* linear = part.as<nn::LinearImpl>()) nn::normal_linear(*linear, std);
    });
  });
}

}  // namespace anigen::models::anymate
