#pragma once
#include "anigen/nn/torch.h"

namespace anigen::models {

/// Occupied voxels and all voxels within Chebyshev distance `radius` of one, clipped by the grid.
/// @param occupied bool [X, Y, Z] @return bool [X, Y, Z]
torch::Tensor dilated_voxels(const torch::Tensor& occupied, std::int64_t radius);

/// How well two sets of voxels agree. All in [0, 1].
struct VoxelAgreement {
  double iou = 0.0;        ///< intersection over union; 1 for two empty sets
  double precision = 0.0;  ///< share of predicted voxels within the tolerance of a true one; 1 when none is predicted
  double recall = 0.0;     ///< share of true voxels within the tolerance of a predicted one; 1 when none is true
  double f1 = 0.0;         ///< harmonic mean of both; 0 when both are 0
};

/// @param predicted, target bool [X, Y, Z] @param tolerance Chebyshev distance in voxels up to which a voxel counts as
/// hit, for precision and recall @throws InputError when shapes differ or are not three-dimensional
VoxelAgreement voxel_agreement(const torch::Tensor& predicted, const torch::Tensor& target, std::int64_t tolerance = 1);

}  // namespace anigen::models
