#pragma once
#include "anigen/flow/flow_stage_options.h"
#include "anigen/flow/sampler.h"
#include "anigen/models/sparse_structure_flow.h"

namespace anigen::models {

/// Arguments of the trainers of stage 4 beside those all trainers share: those of both flows. Samples are guided with
/// strength 7.5 by default.
struct SparseStructureFlowStageOptions : flow::FlowStageOptions {
  /// `image_encoder` is read by features::make_condition_encoder(). @throws InputError
  static SparseStructureFlowStageOptions read(ConfigReader& trainer_args);
};

/// Velocities of the sparse-structure flow for flow::sample_flow: streams shape, then skeleton.
/// @param condition [B, M, C] tokens on the model's device @param guided also the velocity under a condition of zeros
flow::Velocities structure_velocities(SparseStructureFlow model, const torch::Tensor& condition, bool guided);

}  // namespace anigen::models
