#pragma once
#include <cstdint>

#include "anigen/models/flop_count.h"
#include "anigen/models/sparse_structure_flow_options.h"

namespace anigen::models {

/// Of one forward pass. A backward pass through everything takes twice as many, one product per input and one per
/// weight, and more where activations are formed again.
/// @param batch B @param condition_tokens M
FlopCount forward_flops(const SparseStructureFlowOptions& options, std::int64_t batch, std::int64_t condition_tokens);

}  // namespace anigen::models
