#pragma once
#include <string>

#include "anigen/nn/torch.h"

namespace anigen::sparse_structure {

/// The largest set of occupied voxels that touch by faces; of equally large ones that with the first voxel in x, y, z
/// order. What the pipeline keeps of a decoded skeleton (docs/reference/flows.md, 5.4).
/// @param occupied bool [X, Y, Z], CPU @return bool [X, Y, Z] @throws InputError when it has not three axes
torch::Tensor largest_component(const torch::Tensor& occupied);

/// Voxels that a surface encloses, and those of the surface itself. A voxel counts as enclosed when in at least five of
/// the six axis directions a ray from it meets a surface voxel: unlike a flood fill from outside, this forgives the
/// small holes that a decoded surface has. @param surface bool [X, Y, Z], CPU @return bool [X, Y, Z]
torch::Tensor enclosed_voxels(const torch::Tensor& surface);

/// Share of the skeleton's voxels that lie on the surface or inside; 1 when there are none.
/// @throws InputError when shapes differ or are not three-dimensional
double share_inside(const torch::Tensor& skeleton, const torch::Tensor& surface);

/// Occupied voxels and all voxels within Chebyshev distance `radius` of one, clipped by the grid.
/// @param occupied bool [X, Y, Z] @return bool [X, Y, Z]
torch::Tensor dilated_voxels(const torch::Tensor& occupied, std::int64_t radius);

/// Agreement of two sets of voxels. All in [0, 1].
struct VoxelAgreement {
  double iou = 0.0;        ///< intersection over union; 1 for two empty sets
  double precision = 0.0;  ///< share of predicted voxels within the tolerance of a true one; 1 when none is predicted
  double recall = 0.0;     ///< share of true voxels within the tolerance of a predicted one; 1 when none is true
  double f1 = 0.0;         ///< harmonic mean of both; 0 when both are 0
};

/// @param predicted, target bool [X, Y, Z] @param tolerance Chebyshev distance in voxels up to which a voxel counts as
/// hit, for precision and recall @throws InputError when shapes differ or are not three-dimensional
VoxelAgreement voxel_agreement(const torch::Tensor& predicted, const torch::Tensor& target, std::int64_t tolerance = 1);

/// Loss of occupancy logits against occupancy (docs/reference/training.md, 3.2).
enum class OccupancyLoss {
  kDice,  ///< 1 − (2 Σ σ(l) y + 1) / (Σ σ(l) + Σ y + 1), sums over the whole micro-batch and not per sample
  kBce,   ///< mean binary cross entropy
  kL1     ///< mean |σ(l) − y|
};

/// "dice", "bce" or "l1", the values of `loss_type` and the names under which the terms are logged.
OccupancyLoss occupancy_loss_named(const std::string& name);  ///< @throws InputError on another word
std::string name_of(OccupancyLoss loss);

/// @param logits [B, C, R, R, R] @param occupancy the same shape, 0 or 1, any type @return scalar
/// @throws InputError when the shapes differ
torch::Tensor occupancy_loss(const torch::Tensor& logits, const torch::Tensor& occupancy, OccupancyLoss loss);

/// KL(N(mean, e^logvar) ‖ N(0, 1)), the mean over all entries: ½ mean(mean² + e^logvar − logvar − 1). Scalar.
torch::Tensor posterior_kl(const torch::Tensor& mean, const torch::Tensor& logvar);

}  // namespace anigen::sparse_structure
