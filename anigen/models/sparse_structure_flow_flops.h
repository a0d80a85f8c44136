#pragma once
#include <cstdint>

#include "anigen/models/sparse_structure_flow_options.h"

namespace anigen::models {

/// Floating-point operations of a pass, a multiplication and an addition counting as two. Norms, activations,
/// softmax and residual sums are left out: they are a few operations per value.
struct FlopCount {
  double linear = 0.0;     ///< 2 · rows · in · out per linear layer
  double attention = 0.0;  ///< 2 · 2 · N · M · C per attention: scores, and weighted sum of values
  double total() const { return linear + attention; }
};

/// Of one forward pass. A backward pass through everything takes twice as many, one product per input and one per
/// weight, and more where activations are formed again.
/// @param batch B @param condition_tokens M
FlopCount forward_flops(const SparseStructureFlowOptions& options, std::int64_t batch, std::int64_t condition_tokens);

}  // namespace anigen::models
