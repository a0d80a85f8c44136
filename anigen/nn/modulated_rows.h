#pragma once
#include "anigen/nn/ragged.h"

namespace anigen::nn {

/// Adaptive layer norm of a ragged batch, one row of shift and scale per item (reference flows-and-pipeline.md, 1.5):
/// LN(x) (1 + scale) + shift, without parameters of its own: biased variance, eps inside the root. On a CPU, fp32 and
/// bf16 take one pass over memory forward and two backward, bf16 computed in fp32 throughout; they can be
/// differentiated once.
/// @param x [N, C] @param shift, scale [B, C], B the items @return the shape and dtype of x
Tensor modulated_norm(const Tensor& x, const Ragged& items, const Tensor& shift, const Tensor& scale, double eps);

/// LN(x) weight + bias of all rows, otherwise the same. 16-bit input is normalised in fp32 and cast back.
/// @param x [..., C] @param weight, bias [C]
Tensor affine_norm(const Tensor& x, const Tensor& weight, const Tensor& bias, double eps);

/// x + gate · result, one row of gates per item. @param x, result [N, C] @param gate [B, C]
Tensor add_gated(const Tensor& x, const Ragged& items, const Tensor& gate, const Tensor& result);

}  // namespace anigen::nn
