#pragma once
#include "anigen/nn/torch.h"

namespace anigen::nn {

/// GELU in its exact form, x/2 (1 + erf(x/√2)) (Hendrycks and Gimpel 2016, section 2). Unlike torch::gelu() of
/// LibTorch 1.13, its gradient is right when the slopes lie in memory in another order than x, as those of pictures do
/// behind a product of their pixels. @param x any shape and floating dtype @return contiguous, the dtype of x
Tensor gelu_erf(const Tensor& x);

}  // namespace anigen::nn
