#pragma once
#include <cstddef>

#include "anigen/asset/skin_weights.h"
#include "anigen/nn/torch.h"
#include "anigen/pipeline/anymate_models.h"
#include "anigen/pipeline/rig_bones.h"

namespace anigen::pipeline {

/// Skin weights of vertices, a block of them at a time, which does not change them.
/// @param cloud [1, N, 6] what the encoder looks at @param vertices [V, 6] (loaders::vertex_features), on the CPU
/// @param bones at least one @param most_influences joints per vertex; 0: any number
/// @throws InputError naming the model's file when weights are not finite
SkinWeights anymate_skin(const TrainedAnymateModel& skinning, const torch::Tensor& cloud, const torch::Tensor& vertices,
                         const RigBones& bones, std::size_t most_influences);

}  // namespace anigen::pipeline
