#pragma once
#include <cstdint>
#include <memory>
#include <vector>

#include "anigen/train/distributed/communicator.h"
#include "anigen/train/parameter_buffer.h"

namespace anigen::train {

/// Sums the gradients of all ranks while the backward pass is still running: parameters are put into buckets in the
/// order in which their gradients are ready, and a bucket's sum begins when its last one is (the scheme of PyTorch's
/// DistributedDataParallel, Li et al. 2020, section 3.2).
///
/// Which buckets there are is agreed on once, after the first backward pass and before the first sum: rank 0's order
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
  void expect_last_backward();
  /// After the last backward pass: adds the gradients of the other copies and begins the sums that have not begun.
  /// @param buffers the one of the constructor first, then those of replicas
  /// @throws Error when a part of a gradient came after its bucket had left
  void start_rest(const std::vector<ParameterBuffer>& buffers);
  /// gradient() holds the sums. @return seconds it waited, the communication that nothing hid
  double finish();

  /// Whether this rank's own gradients of the step were finite before they were summed.
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
