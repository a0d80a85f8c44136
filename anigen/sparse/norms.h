#pragma once
#include "anigen/sparse/support.h"

namespace anigen::sparse {

/// (x − μ) / √(σ² + eps) · weight + bias, and SiLU of it if asked for, with mean and biased variance per item and group
/// of channels over all voxels of the item. fp32 inside for 16-bit types, cast back. Items may be empty. Differentiable
/// once in feats, weight, bias; holds no other tensor of the size of feats than its result.
/// @param feats [N, C] @param items rows of each item @param weight, bias [C] @param groups divides C
Tensor sparse_group_norm(const Tensor& feats, const nn::Ragged& items, const Tensor& weight, const Tensor& bias,
                         std::int64_t groups, double eps, bool silu = false);

/// Group norm with statistics per item over its voxels and the channels of a group; fp32 inside, cast back; keys
/// `weight`, `bias`, initially 1 and 0 only through default_group_norms (docs/reference/autoencoders.md, 1.2).
class SparseGroupNormImpl : public torch::nn::Module {
 public:
  explicit SparseGroupNormImpl(std::int64_t channels, std::int64_t groups = 32, double eps = 1e-5);
  SparseTensor forward(const SparseTensor& x, bool silu = false);  ///< SiLU of the result if asked for
  Tensor weight, bias;

 private:
  std::int64_t groups_;
  double eps_;
};
TORCH_MODULE(SparseGroupNorm);

void default_group_norms(torch::nn::Module& module);

}  // namespace anigen::sparse
