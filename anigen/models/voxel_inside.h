#pragma once
#include "anigen/nn/torch.h"

namespace anigen::models {

/// Voxels that a surface encloses, and those of the surface itself. A voxel counts as enclosed when in at least five of
/// the six axis directions a ray from it meets a surface voxel: unlike a flood fill from outside, this forgives the
/// small holes that a decoded surface has. @param surface bool [X, Y, Z], CPU @return bool [X, Y, Z]
torch::Tensor enclosed_voxels(const torch::Tensor& surface);

/// Share of the skeleton's voxels that lie on the surface or inside; 1 when there are none.
/// @throws InputError when shapes differ or are not three-dimensional
double share_inside(const torch::Tensor& skeleton, const torch::Tensor& surface);

}  // namespace anigen::models
