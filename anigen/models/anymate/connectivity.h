#pragma once
#include "anigen/nn/torch.h"

namespace anigen::models::anymate {

using torch::Tensor;

/// Who is whose parent, from joints and a shape. Row i of the logits is joint i as a child, column m a candidate for
/// its parent, and column i of row i says that i is a root (reference anymate-baselines.md, 1.6 and 4).
class ConnectivityImpl : public torch::nn::Module {
 public:
  /// @param latents [B, L, W] @param joints [B, J or more, 3] in [-1, 1], padded @param mask [B, J], not zero for real
  ///   joints; undefined: all of them are @return [B, J, J] logits @throws InputError for shapes
  virtual Tensor forward(const Tensor& latents, const Tensor& joints, const Tensor& mask = {}) = 0;
};

/// Mean over all rows of a batch, padded ones included (they add nothing), of - Σ y ln(softmax(logits) + 1e-6).
/// @param logits [B, J, J] @param parents [B, J or more, J] one in the column of the parent (a root's own), zero rows
/// for
///   padding (AnymateBatch::conns) @return scalar @throws InputError for shapes
Tensor connectivity_loss(const Tensor& logits, const Tensor& parents);

/// The most likely parent of each joint; a joint that is its own parent is a root. Nothing makes a tree of it: several
/// roots, none, and cycles are possible. @param logits [J, J] or [B, J, J] @return [J] or [B, J] int64
Tensor likeliest_parents(const Tensor& logits);

/// Bones of a skeleton as Anymate's skinning takes them: for each joint that is no root, in order, the position of its
/// parent, then its own. @param joints [J, 3] @param parents [J] int64, its own index for a root @return [K, 6]
/// @throws InputError for shapes and for a parent that is no joint
Tensor bones_of(const Tensor& joints, const Tensor& parents);

}  // namespace anigen::models::anymate
