#pragma once
#include "anigen/nn/torch.h"

namespace anigen::nn {

/// SiLU(LN(x) weight + bias) over the last dimension: biased variance, eps inside the root. fp32 on a CPU takes one
/// pass over memory forward and one backward, keeps only x and two numbers per row for it, gives the same bits for any
/// number of threads, and can be differentiated once. 16-bit input is normalised in fp32 and cast back before SiLU.
/// @param x [..., C] @param weight, bias [C] @return the shape and dtype of x
Tensor norm_silu(const Tensor& x, const Tensor& weight, const Tensor& bias, double eps);

}  // namespace anigen::nn
