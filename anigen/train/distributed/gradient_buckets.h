#pragma once
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "anigen/train/distributed/communicator.h"
#include "anigen/train/parameters.h"

namespace anigen::train {

/// Statement of one rank about a step, and those of all ranks.
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

/// A checksum of a tensor's bits, at the speed of reading them. It changes with every bit and with the order.
/// @param flat contiguous, of 4- or 8-byte elements
std::uint64_t checksum(const torch::Tensor& flat);

/// Compares a tensor over all ranks, bit for bit (by checksum; 8 bytes per rank are sent). All ranks must call it.
/// @param moment for the message: "step 100" @throws Error on every rank, naming those that differ from most others
void require_same_parameters(Communicator& ranks, const torch::Tensor& flat, const std::string& moment);

/// Sums the gradients of all ranks while the backward pass is still running: parameters are put into buckets in the
/// order in which their gradients are ready, and a bucket's sum begins when its last one is (the scheme of PyTorch's
/// DistributedDataParallel, Li et al. 2020, section 3.2).
///
/// Ranks agree on the buckets once, after the first backward pass and before the first sum: rank 0's order
/// of readiness, and for parameters that got no gradient then, backwards as they are registered. All steps of a run and
/// of its restarts thus sum in the same buckets. A parameter without gradient in a step counts as zero and is sent when
/// the backward pass is over. So is one whose gradient comes in parts, as it can where blocks are computed again in the
/// backward pass.
///
/// Only the last backward pass of a step is listened to. Copies of the models in one process (replicas) end theirs at
/// different times; then nothing overlaps with a pass, but a bucket travels while the next one's replicas are added.
class GradientBuckets {
 public:
  struct Options {
    std::int64_t bytes = std::int64_t{25} << 20;       ///< of a bucket, reached by at most one parameter more
    std::int64_t first_bytes = std::int64_t{1} << 20;  ///< of the first, which should leave early
    bool overlap = true;                               ///< false: no sum begins before the backward pass is over
  };

  /// @param buffer whose gradient() is summed; must outlive this, as `ranks` must
  GradientBuckets(ParameterBuffer& buffer, Communicator& ranks, const Options& options);
  ~GradientBuckets();
  GradientBuckets(const GradientBuckets&) = delete;
  GradientBuckets& operator=(const GradientBuckets&) = delete;

  /// The next backward pass is the step's last.
  void expect_last_backward() { listening_ = true; }
  /// After the last backward pass: adds the gradients of the other copies and begins the sums that have not begun.
  /// @param buffers the one of the constructor first, then those of replicas
  /// @throws Error when a part of a gradient came after its bucket had left
  void start_rest(const std::vector<ParameterBuffer>& buffers);
  /// gradient() holds the sums. @return seconds it waited, the communication that nothing hid
  double finish();

  /// True when this rank's own gradients of the step were finite before they were summed.
  bool own_gradients_finite() const;
  std::size_t buckets() const { return plan_.size(); }

 private:
  struct Bucket {
    std::vector<std::size_t> slots;
    torch::Tensor flat;  // [n] what is sent: a part of gradient() where the slots lie side by side
    bool in_place = false;
    std::size_t missing = 0;  // slots whose gradients are not there yet
    std::unique_ptr<PendingSum> sum;
  };
  void ready(std::size_t slot);
  void agree_on_plan();
  void add_bucket(const std::vector<std::size_t>& slots);
  void start(Bucket& bucket, const std::vector<ParameterBuffer>* buffers);

  ParameterBuffer& buffer_;
  Communicator& ranks_;
  Options options_;
  std::vector<std::shared_ptr<torch::autograd::Node>> accumulators_;  // of the slots; LibTorch only keeps weak ones
  std::vector<std::uintptr_t> hooks_;
  std::vector<Bucket> plan_;
  std::vector<std::size_t> bucket_of_;   // by slot
  std::vector<bool> ready_;              // by slot, in this step
  std::vector<bool> in_parts_;           // by slot: its gradient came more than once in a backward pass
  std::vector<std::size_t> order_;       // of readiness, until there is a plan
  std::vector<torch::Tensor> own_sums_;  // of the buckets before they were summed
  std::size_t next_ = 0;                 // bucket to begin; all ranks must begin them in the same order
  bool listening_ = false;
  std::size_t late_;  // slot that came after its bucket had left
};

}  // namespace anigen::train
