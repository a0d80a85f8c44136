#pragma once
#include <cstddef>
#include <vector>

#include "anigen/asset/skeleton.h"
#include "anigen/asset/skin_weights.h"
#include "anigen/nn/torch.h"
#include "anigen/pipeline/anymate_models.h"

namespace anigen::pipeline {

/// The bones that Anymate's skinning weighs, and whom their weights move.
struct AnymateBones {
  torch::Tensor bones;     ///< [K, 6] fp32: head and tail
  std::vector<int> heads;  ///< [K] joints: a bone moves with the joint at its head (io/rigs/anymate_sample.h)
};

/// Bones of joints that Anymate predicts, ends of bones among them: for every joint but the root one from its parent to
/// itself (reference anymate-baselines.md, 1.5).
/// @param joints [J, 3] in Anymate's frame @param parents [J], -1 for the root
AnymateBones anymate_bones(const torch::Tensor& joints, const std::vector<int>& parents);

/// Bones of any other rig, where all joints move something: one from every joint, as in the data that the models learn
/// from (loaders/anymate/bone_layout.h), to its child, or to the middle of its children. Where there is no child, these
/// data have it end where its weights are; here it goes half of its parent's bone straight on.
AnymateBones bones_of_rig(const torch::Tensor& joints, const std::vector<int>& parents);

/// Skin weights of vertices, a block of them at a time, which does not change them.
/// @param cloud [1, N, 6] what the encoder looks at @param vertices [V, 6] (loaders::vertex_features), on the CPU
/// @param bones at least one @param most_influences joints per vertex; 0: any number
/// @throws InputError naming the model's file when weights are not finite
SkinWeights anymate_skin(const TrainedAnymateModel& skinning, const torch::Tensor& cloud, const torch::Tensor& vertices,
                         const AnymateBones& bones, std::size_t most_influences);

}  // namespace anigen::pipeline
