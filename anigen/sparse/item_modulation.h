#pragma once
#include <utility>

#include "anigen/nn/modulated_block.h"
#include "anigen/sparse/sparse_tensor.h"

namespace anigen::sparse {

/// What one half of a modulated block takes from the modulation: a row of shift, scale and gate per item.
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
