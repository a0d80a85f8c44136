#pragma once
#include <vector>

#include "anigen/models/structured_latent_flow_stream.h"

namespace anigen::models {

/// The published initial values of a structured-latent flow (reference flows-and-pipeline.md, 2.8). Modulations, last
/// convolutions, adapters and last layers are zero: a fresh model answers zero, and the skin hears nothing of the
/// geometry.
/// @param model the module that owns streams and adapters
void initialize_flow(torch::nn::Module& model, const std::vector<StructuredLatentFlowStream*>& streams,
                     const std::vector<nn::Linear>& adapters);

}  // namespace anigen::models
