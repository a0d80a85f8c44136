#pragma once
#include "anigen/nn/torch.h"

namespace anigen::models {

using torch::Tensor;

/// Every pixel becomes 8 × 8, each a convex combination of the 3 × 3 pixels around it (Teed and Deng 2020, "RAFT",
/// section 3.3; reference normal-estimator.md, 8); beyond the border the nearest pixel of the border.
/// @param x [B, C, H, W] @param mask [B, 9 · 8 · 8, H, W]: neighbour, row and column within the pixel, from outer to
///   inner; before the softmax over the neighbours @return [B, C, 8 H, 8 W]
Tensor convex_upsampling(const Tensor& x, const Tensor& mask);

}  // namespace anigen::models
