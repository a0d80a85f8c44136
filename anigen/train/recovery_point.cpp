#include "anigen/train/recovery_point.h"

#include <cmath>
#include <string>

#include "anigen/core/error.h"

namespace anigen::train {
namespace {

/// A sum that is finite has only finite terms; one that is not may also have overflowed.
bool all_finite(const torch::Tensor& flat) {
  return std::isfinite(flat.sum().item<double>()) || torch::isfinite(flat).all().item<bool>();
}

}  // namespace

void RecoveryPoint::before_update(std::int64_t step, const torch::Tensor& master) {
  if (step % kEvery == 0 && all_finite(master)) restore(step, master);
}

bool RecoveryPoint::after_update(std::int64_t step, torch::Tensor master) const {
  const torch::NoGradGuard no_grad;
  if (all_finite(master)) return false;
  if (step_ < 0) {
    throw Error("step " + std::to_string(step) +
                ": the update left weights that are not finite, and there are no earlier ones to go back to");
  }
  master.copy_(master_);
  return true;
}

void RecoveryPoint::restore(std::int64_t step, const torch::Tensor& master) {
  const torch::NoGradGuard no_grad;
  if (master_.defined()) {
    master_.copy_(master);
  } else {
    master_ = master.detach().clone();
  }
  step_ = step;
}

}  // namespace anigen::train
