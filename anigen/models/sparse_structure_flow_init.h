#pragma once
#include "anigen/models/sparse_structure_flow_stream.h"

namespace anigen::models {

/// The published initial values of a sparse-structure flow (reference flows-and-pipeline.md, 1.7 and 1.8). Modulation,
/// adapters and last layers are zero: a fresh model answers zero, and both streams ignore each other.
/// @param model the module that owns both streams
void initialize_flow(torch::nn::Module& model, FlowStream& shape, FlowStream& skeleton);

}  // namespace anigen::models
