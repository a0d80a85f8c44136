#pragma once
#include <string>
#include <vector>

#include "anigen/nn/torch.h"

namespace anigen::models {

/// Turns off gradients below the named attributes of a model, as `modules_to_freeze` does (reference autoencoders.md,
/// 2.4): a name stands for exactly the child module or parameter of that name — `blocks` is not `blocks_skl` — and
/// names the model lacks are ignored. Parameters whose own path contains "lora" stay trainable: low-rank additions are
/// what a frozen stream learns.
void freeze_modules(torch::nn::Module& module, const std::vector<std::string>& names);

/// State-dict keys of the parameters that ask for no gradient, in registration order.
std::vector<std::string> frozen_parameters(const torch::nn::Module& module);

}  // namespace anigen::models
