#pragma once
#include <utility>

#include "anigen/nn/blocks.h"
#include "anigen/sparse/support.h"

namespace anigen::sparse {

/// (x − μ) / √(σ² + eps) · weight + bias, with mean and biased variance per item and group of channels over all voxels
/// of the item. fp32 inside for 16-bit types, cast back. Items may be empty. Differentiable once in feats, weight,
/// bias; holds no other tensor of the size of feats than its result.
/// @param feats [N, C] @param items rows of each item @param weight, bias [C] @param groups divides C
Tensor sparse_group_norm(const Tensor& feats, const nn::Ragged& items, const Tensor& weight, const Tensor& bias,
                         std::int64_t groups, double eps);

/// Group norm with statistics per item over its voxels and the channels of a group; fp32 inside, cast back; keys
/// `weight`, `bias`, initially 1 and 0 only through default_group_norms (reference autoencoders.md, 0.2, GN).
class SparseGroupNormImpl : public torch::nn::Module {
 public:
  explicit SparseGroupNormImpl(std::int64_t channels, std::int64_t groups = 32, double eps = 1e-5);
  SparseTensor forward(const SparseTensor& x);
  Tensor weight, bias;

 private:
  std::int64_t groups_;
  double eps_;
};
TORCH_MODULE(SparseGroupNorm);

void default_group_norms(torch::nn::Module& module);

/// Modulation of one half of a block: a row of shift, scale and gate per item.
class ItemModulation {
 public:
  /// @param shift, scale, gate [B, C], one row per item of the support; without a gate only modulate() can be used
  ItemModulation(SupportPtr support, Tensor shift, Tensor scale, Tensor gate = {});

  /// LN(x) (1 + scale) + shift, eps 1e-6. @param x [N, C]
  Tensor modulate(const Tensor& x) const;
  /// x + gate · result. @param x, result [N, C]
  Tensor add_gated(const Tensor& x, const Tensor& result) const;

 private:
  SupportPtr support_;  // keeps items() alive
  Tensor shift_, scale_, gate_;
};

/// Those of the attention and of the MLP (chunks: shift, scale, gate of one, then of the other; reference
/// flows-and-pipeline.md, 1.5).
/// @param layer of a block with a modulation of its own, else null
/// @param mod [B, C], or without a layer [B, 6C]
std::pair<ItemModulation, ItemModulation> item_modulations(nn::Modulation& layer, const Tensor& mod,
                                                           const SparseTensor& x);

/// The linear layer of a modulation; null for a null one.
nn::Linear linear_layer_of(const nn::Modulation& modulation);

}  // namespace anigen::sparse
