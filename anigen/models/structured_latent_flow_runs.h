#pragma once
#include "anigen/models/run_model.h"
#include "anigen/models/structured_latent_flow.h"

namespace anigen::models {

/// The flow model of stage 5 in configs: two published names of the same computation.
inline constexpr const char* kStructuredLatentFlowClass = "AniGenElasticSLatFlowModel";
inline constexpr const char* kPlainStructuredLatentFlowClass = "AniGenSLatFlowModel";

/// A trained flow of stage 5 for use: weights loaded strictly, in fp32, evaluation mode, nothing asks for gradients.
/// @param found by find_run_model() @throws InputError when arguments or weights do not fit
StructuredLatentFlow load_structured_latent_flow(const RunModel& found, torch::Device device);

}  // namespace anigen::models
