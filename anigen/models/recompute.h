#pragma once
#include <functional>
#include <vector>

#include "anigen/nn/torch.h"

namespace anigen::models {

/// Part of a network that keeps nothing but its inputs for the backward pass, which runs it forward a second time:
/// less memory for a third more work ("gradient checkpointing"). The part must give the same result both times, so it
/// must draw no random numbers. Gradients reach its inputs and any parameters it uses; those of parameters are added
/// to `.grad` directly, so use backward(), not torch::autograd::grad() for them. Can be differentiated once.
/// @param part a function of the inputs; kept alive until the backward pass
torch::Tensor recomputed(const std::vector<torch::Tensor>& inputs,
                         const std::function<torch::Tensor(const std::vector<torch::Tensor>&)>& part);

}  // namespace anigen::models
