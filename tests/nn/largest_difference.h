#pragma once
#include "anigen/nn/torch.h"

namespace anigen::nn {

inline double largest_difference(const Tensor& a, const Tensor& b) { return (a - b).abs().max().item<double>(); }

}  // namespace anigen::nn
