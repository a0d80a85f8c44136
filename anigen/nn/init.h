#pragma once
#include "anigen/nn/torch.h"

namespace anigen::nn {

/// What a model's constructor leaves in its parameters.
enum class Init {
  kPublished,  ///< the published initial values, drawn from torch's default generator (seed it with torch::manual_seed)
  kNone        ///< nothing: memory is reserved but not written; load every tensor (strictly) before use
};

/// Xavier-uniform weights and zero biases for every Linear below `module` (reference autoencoders.md, 1.3 and 3.10).
void xavier_uniform_linears(torch::nn::Module& module);

/// Whether fp16 conversion of a model concerns this module's own parameters.
bool is_linear_or_convolution(const torch::nn::Module& module);

/// Converts the parameters of every Linear and convolution below `module`, in place; norms and bare parameters keep
/// their type (reference autoencoders.md, 0.4, "fp16 torso").
void cast_linears(torch::nn::Module& module, torch::Dtype dtype);

}  // namespace anigen::nn
