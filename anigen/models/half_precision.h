#pragma once
#include "anigen/nn/torch.h"

namespace anigen::models {

/// Whether the published fp16 conversion concerns this module's own parameters: linears and convolutions, dense and
/// sparse. Norms and bare parameters stay fp32 (reference autoencoders.md, 0.4, "fp16 torso").
bool converts_to_half(const torch::nn::Module& module);

/// Converts the parameters of every such module at or below `module`, in place.
void cast_torso(torch::nn::Module& module, torch::Dtype dtype);

}  // namespace anigen::models
