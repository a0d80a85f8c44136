#pragma once
#include "anigen/nn/init.h"

namespace anigen::models::anymate {

/// PyTorch's default for every nn::Linear and PointwiseConv below `module`, weight and bias uniform in ± 1 / sqrt(fan
/// in), and ones and zeros for its layer norms: what the released modules start with where they say nothing else.
void default_layers(torch::nn::Module& module);

/// N(0, std²) weights and zero biases for the linear maps inside every residual attention block at or below `module`
/// (reference anymate-baselines.md, 2.1). Call it after default_layers.
void normal_blocks(torch::nn::Module& module, double std);

}  // namespace anigen::models::anymate
