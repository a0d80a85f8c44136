#pragma once
#include "anigen/flow/sampler.h"
#include "anigen/models/sparse_structure_flow.h"

namespace anigen::train {

/// Velocities of the sparse-structure flow for flow::sample_flow: streams shape, then skeleton.
/// @param condition [B, M, C] tokens on the model's device @param guided also the velocity under a condition of zeros
flow::Velocities structure_velocities(models::SparseStructureFlow model, const torch::Tensor& condition, bool guided);

}  // namespace anigen::train
