#pragma once
#include "anigen/nn/torch.h"

namespace anigen::nn {

inline constexpr double kBlockNormEps =
    1e-6;  ///< layer norms inside transformer blocks (reference autoencoders.md, 0.2)

/// Layer norm over the last axis without parameters: biased variance, eps inside the root. 16-bit input is
/// normalised in fp32 and cast back. @param x [..., C] @return the shape and dtype of x
Tensor layer_norm(const Tensor& x, double eps = kBlockNormEps);

/// x / max(||x||_2, 1e-12) over the last axis.
Tensor unit_length(const Tensor& x);

}  // namespace anigen::nn
