#pragma once
#include "anigen/nn/torch.h"

namespace anigen::nn {

using torch::Tensor;

/// Whether bf16 products on this CPU are better done in fp32: LibTorch then has no bf16 kernel of its own but a loop
/// more than ten times slower (no oneDNN, or no AVX-512). @param x, weight of a linear layer
bool prefers_widened_linear(const Tensor& x, const Tensor& weight);

/// torch::linear for bf16 on a CPU: inputs widened to fp32, products and sums in fp32, the result rounded once. Keeps
/// only the bf16 tensors for the backward pass. @param x [..., in] @param weight [out, in] @param bias [out] or
/// undefined
Tensor widened_linear(const Tensor& x, const Tensor& weight, const Tensor& bias);

}  // namespace anigen::nn
