#pragma once
#include "anigen/nn/torch.h"

namespace anigen::nn {

/// gelu(x W1ᵀ + b1) W2ᵀ + b2, as one operation on many rows in CPU memory. A few hundred rows at a time pass through
/// both layers while their hidden values stay in the cache; the backward pass computes these again instead of storing
/// them. Against separate layers this spares eight times the memory traffic of the input (hidden width four, written
/// and read back), and the page faults of allocating it. Can be differentiated once.
/// @param x [N, in] fp32 @param w1 [hidden, in] @param b1 [hidden] @param w2 [out, hidden] @param b2 [out] @return [N,
/// out]
Tensor fused_mlp(const Tensor& x, const Tensor& w1, const Tensor& b1, const Tensor& w2, const Tensor& b2);

/// Whether fused_mlp applies to this input and is the faster way.
bool prefers_fused_mlp(const Tensor& x, const Tensor& w1);

}  // namespace anigen::nn
