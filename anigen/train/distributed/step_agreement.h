#pragma once
#include <memory>
#include <vector>

#include "anigen/train/distributed/communicator.h"

namespace anigen::train {

/// What one rank has to say about a step, and what all of them said.
struct StepReport {
  double loss_sum = 0.0;     ///< over micro-batches
  bool bad_loss = false;     ///< one was not finite
  bool interrupted = false;  ///< a signal asked this process to stop
  bool out_of_time = false;  ///< by this process's clock
};
struct StepVerdict {
  double loss_sum = 0.0;      ///< over all ranks
  std::vector<int> bad_loss;  ///< ranks
  bool interrupted = false;   ///< any rank was
  bool out_of_time = false;   ///< by rank 0's clock
};

/// Brings reports together: one small exact sum that travels beside the gradients.
class StepAgreement {
 public:
  /// Call when every sum of gradients has begun. @param ranks must outlive this
  StepAgreement(Communicator& ranks, const StepReport& report);
  StepVerdict finish();

 private:
  torch::Tensor values_;  // fp64 [3 + ranks]
  std::unique_ptr<PendingSum> sum_;
};

}  // namespace anigen::train
