#include "anigen/models/structured_latent_init.h"

#include "anigen/nn/init.h"
#include "anigen/sparse/subdivide_block.h"

namespace anigen::models {
namespace {

constexpr double kFieldHeadScale = 1e-4;

}  // namespace

void initialize_sparse_layers(torch::nn::Module& module) {
  nn::xavier_uniform_linears(module);
  nn::default_norms(module);
  sparse::default_group_norms(module);
  sparse::default_submanifold_kernels(module);
  module.apply([](torch::nn::Module& part) {
    if (auto* block = part.as<sparse::SubdivideBlockImpl>()) block->initialize();
  });
}

void initialize_field_head(nn::LinearImpl& head) {
  const torch::NoGradGuard no_grad;
  torch::nn::init::kaiming_normal_(head.weight, 0.0, torch::kFanIn, torch::kReLU);
  head.weight.mul_(kFieldHeadScale);
  torch::nn::init::zeros_(head.bias);
}

}  // namespace anigen::models
