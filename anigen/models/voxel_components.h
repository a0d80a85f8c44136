#pragma once
#include "anigen/nn/torch.h"

namespace anigen::models {

/// The largest set of occupied voxels that touch by faces; of equally large ones that with the first voxel in x, y, z
/// order. What the pipeline keeps of a decoded skeleton (reference flows-and-pipeline.md, 5.5).
/// @param occupied bool [X, Y, Z], CPU @return bool [X, Y, Z] @throws InputError when it has not three axes
torch::Tensor largest_component(const torch::Tensor& occupied);

}  // namespace anigen::models
