#pragma once
#include <cstdint>

#include "anigen/nn/torch.h"

namespace anigen::flow {

using torch::Tensor;

/// Classifier-free guidance needs a model that also knows the absence of a condition: in training each item's
/// condition is replaced by the negative one with probability p_uncond (reference flows-and-pipeline.md, 4.2).
/// @param probability in [0, 1]
/// @return [count] bool on the CPU, drawn from this generator alone: which items lose their condition
Tensor draw_condition_dropout(std::int64_t count, double probability, at::Generator generator);

/// @param condition [B, ...] @param dropped [B] bool @param negative like condition; undefined: zeros, the negative of
/// image conditions @return the condition with the dropped items replaced
Tensor replace_condition(const Tensor& condition, const Tensor& dropped, const Tensor& negative = {});

}  // namespace anigen::flow
