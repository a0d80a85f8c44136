#pragma once
#include <torch/torch.h>

#include <cstdint>

namespace anigen::train {

/// The last weights known to be sound, to go back to when an update leaves weights that are not finite (reference
/// training-and-data.md, section 2.4, steps 4 and 7). Only the master weights are kept: the models' own are always
/// those, converted. Moments of the optimiser are not kept, as published.
class RecoveryPoint {
 public:
  static constexpr std::int64_t kEvery = 10;  ///< steps from one clone to the next

  /// Keeps a clone before the update of every tenth step, when all of `master` is finite.
  void before_update(std::int64_t step, const torch::Tensor& master);

  /// Puts the clone in the place of weights that are not all finite. @return whether it had to
  /// @throws Error when it had to and there is no clone
  bool after_update(std::int64_t step, torch::Tensor master) const;

  /// Whether a run that is saved between two steps needs the clone to go on with the same bits: not when its next step
  /// takes a new one. @param next_step the step that comes after the checkpoint
  bool belongs_to_state(std::int64_t next_step) const { return step_ >= 0 && next_step % kEvery != 0; }

  std::int64_t step() const { return step_; }              ///< of the clone; -1 without one
  const torch::Tensor& master() const { return master_; }  ///< [P] fp32, undefined without a clone
  /// @param master is copied
  void restore(std::int64_t step, const torch::Tensor& master);

 private:
  std::int64_t step_ = -1;
  torch::Tensor master_;
};

}  // namespace anigen::train
