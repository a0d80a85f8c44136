#pragma once
#include <string>

#include "anigen/nn/torch.h"

namespace anigen::models {

/// How occupancy logits are compared with occupancy (reference training-and-data.md, 3.2).
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

}  // namespace anigen::models
