#pragma once
#include "anigen/nn/torch.h"

namespace anigen::sparse {

using torch::Tensor;

/// A convolution over the neighbours of N voxels as a differentiable function of feats, matrices and bias; once only.
/// @param feats [N, Cin] @param matrices [27, Cin, Cout], or with `subdivide` [64, Cin, Cout] (submanifold_plan,
/// subdivision_plan) @param bias [Cout]; both in the type that sums of feats are formed in
/// @param neighbours [27, N] int32, on the device of feats @return [N, Cout], or with `subdivide` [8 N, Cout]; the
/// dtype of feats
Tensor tap_function(const Tensor& feats, const Tensor& matrices, const Tensor& bias, const Tensor& neighbours,
                    bool subdivide);

}  // namespace anigen::sparse
