#pragma once
#include <vector>

#include "anigen/nn/torch.h"

namespace anigen::pipeline {

/// The bones that a learned skinning weighs, and whom their weights move.
struct RigBones {
  torch::Tensor bones;     ///< [K, 6] fp32: head and tail, in the frame of the joints
  std::vector<int> heads;  ///< [K] joints: a bone moves with the joint at its head (io/rigs/anymate_sample.h)
};

/// Bones of joints as Anymate's data have them, ends of bones among them: for every joint but the root one from its
/// parent to itself (reference anymate-baselines.md, 1.5). @param joints [J, 3] @param parents [J], -1 for the root
RigBones bones_between(const torch::Tensor& joints, const std::vector<int>& parents);

/// Bones of any other rig, where all joints move something: one from every joint, as in the data that the models learn
/// from (loaders/anymate/bone_layout.h), to its child, or to the middle of its children. Where there is no child, these
/// data have it end where its weights are; here it goes half of its parent's bone straight on.
RigBones bones_of_rig(const torch::Tensor& joints, const std::vector<int>& parents);

}  // namespace anigen::pipeline
