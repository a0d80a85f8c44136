#pragma once
#include "anigen/nn/torch.h"

namespace anigen::models::rignet {

using torch::Tensor;

/// One step of mean shift, all points at once and among themselves, under the Epanechnikov kernel
/// k_ij = max(h² − ‖p_i − p_j‖², 0) · a_j: p_i moves by `step` of the way to Σ_j k_ij p_j / Σ_j k_ij (reference
/// anymate-baselines.md, 9.3, which weighs by a_i: taken as the attention of the point that is weighed). A point that
/// nothing within reach attends to stays. Differentiable in all three.
/// @param points [N, 3] @param attention [N], not negative @param bandwidth scalar h > 0 @return [N, 3]
/// @throws InputError for shapes
Tensor mean_shifted(const Tensor& points, const Tensor& attention, const Tensor& bandwidth, double step = 0.3);

/// max(h² − ‖p_i − p_j‖², 0). @param points [N, 3] @param bandwidth scalar @return [N, N]
Tensor epanechnikov(const Tensor& points, const Tensor& bandwidth);

}  // namespace anigen::models::rignet
