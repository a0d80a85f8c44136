#include "anigen/models/sparse_structure_loss.h"

#include "anigen/core/error.h"

namespace anigen::models {
namespace {

using torch::Tensor;

Tensor dice(const Tensor& probability, const Tensor& occupancy) {
  const Tensor common = (probability * occupancy).sum();
  return 1.0 - (2.0 * common + 1.0) / (probability.sum() + occupancy.sum() + 1.0);
}

}  // namespace

OccupancyLoss occupancy_loss_named(const std::string& name) {
  for (const OccupancyLoss loss : {OccupancyLoss::kDice, OccupancyLoss::kBce, OccupancyLoss::kL1}) {
    if (name_of(loss) == name) return loss;
  }
  throw InputError("", "loss_type", "expected dice, bce or l1, found '" + name + "'");
}

std::string name_of(OccupancyLoss loss) {
  switch (loss) {
    case OccupancyLoss::kDice:
      return "dice";
    case OccupancyLoss::kBce:
      return "bce";
    default:
      return "l1";
  }
}

Tensor occupancy_loss(const Tensor& logits, const Tensor& occupancy, OccupancyLoss loss) {
  if (logits.sizes() != occupancy.sizes()) throw InputError("", "", "logits and occupancy differ in shape");
  const torch::Dtype dtype = nn::accumulation_dtype(logits.scalar_type());
  const Tensor l = logits.to(dtype), y = occupancy.to(dtype);
  if (loss == OccupancyLoss::kBce) return torch::binary_cross_entropy_with_logits(l, y);
  const Tensor probability = torch::sigmoid(l);
  return loss == OccupancyLoss::kDice ? dice(probability, y) : (probability - y).abs().mean();
}

Tensor posterior_kl(const Tensor& mean, const Tensor& logvar) {
  return 0.5 * (mean.square() + logvar.exp() - logvar - 1.0).mean();
}

}  // namespace anigen::models
