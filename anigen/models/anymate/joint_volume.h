#pragma once
#include <vector>

#include "anigen/nn/torch.h"

namespace anigen::models::anymate {

using torch::Tensor;

inline constexpr std::int64_t kVolumeSide = 64;             ///< cells of the grid of occupied voxels
inline constexpr std::int64_t kMostTrainingVoxels = 50000;  ///< of one item in a training step

/// A field over space that is high at joints, asked about at points. The logits of a point do not depend on the other
/// points asked about.
class JointVolumeImpl : public torch::nn::Module {
 public:
  /// @param latents what the encoder gives for this decoder: [B, L, W], or [B, W] for the tri-plane
  /// @param queries [B, V, 3] in [-1, 1] @return [B, V, 1] logits @throws InputError for shapes
  virtual Tensor forward(const Tensor& latents, const Tensor& queries) = 0;
};

/// Where the field of an item is asked about: the lower corner of each occupied cell, i / 32 - 1 (reference
/// anymate-baselines.md, 1.4 and 3.5). @param voxels [V, 3] integers in [0, 64) @return [V, 3] fp32
/// @throws InputError for another shape or an index outside
Tensor voxel_corners(const Tensor& voxels);

/// At most `most` rows, drawn from torch's default generator; all of them, in order, when there are no more.
Tensor training_voxels(const Tensor& voxels, std::int64_t most = kMostTrainingVoxels);

/// exp(-d² / 2σ²) of the distance d to the nearest joint, σ = 1/32, one cell.
/// @param queries [V, 3] @param joints [J, 3], J > 0 @return [V] @throws InputError
Tensor joint_heat(const Tensor& queries, const Tensor& joints);

/// Mean over items of the binary cross entropy between the field and joint_heat, each the mean over its voxels.
/// @param voxels of each item [V, 3] @param joints of each item [J, 3] @throws InputError when numbers of items differ
Tensor joint_volume_loss(JointVolumeImpl& model, const Tensor& latents, const std::vector<Tensor>& voxels,
                         const std::vector<Tensor>& joints);

/// The field of one item at all of its voxels, `chunk` at a time (the same as all at once), without gradients.
/// @param latents [1, ...] @return [V, 1] logits
Tensor joint_volume(JointVolumeImpl& model, const Tensor& latents, const Tensor& voxels, std::int64_t chunk = 16384);

/// Joints from a field (reference anymate-baselines.md, 3.5): cells above a level fall into clusters of neighbours (26
/// of them); as long as a cluster has ten cells or more, its lower values are cut away and what remains is clustered
/// again. A cluster of equal values, for which the released program never ends, is left as it is.
/// @param logits [V] or [V, 1] @param voxels [V, 3] integers in [0, 64); of a cell named twice the last value counts
/// @return [K, 3] fp64, mean corner of each cluster, clusters by their first cell in x, y, z order
/// @throws InputError for shapes, indices outside and values that are not finite
Tensor joint_key_points(const Tensor& logits, const Tensor& voxels);

}  // namespace anigen::models::anymate
