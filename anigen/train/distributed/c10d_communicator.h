#pragma once
#include <atomic>
#include <chrono>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "anigen/train/distributed/c10d.h"
#include "anigen/train/distributed/join_ranks.h"
#include "anigen/train/distributed/serial_thread.h"
#include "anigen/train/distributed/watchdog.h"

#if ANIGEN_HAS_C10D
namespace anigen::train {

/// Ranks that talk through c10d: everything on a CPU through Gloo, sums of tensors on a GPU through NCCL where it is
/// there, else through Gloo by way of the CPU.
///
/// Gloo sums in a ring, which leaves the same bits everywhere. It has no bf16; such a sum is made of two exchanges with
/// the volume of a ring: every rank gets its part of all tensors in bf16, sums it in fp32, and sends the sum in bf16 to
/// all. These run on a thread of their own, as every other sum does then, since all ranks must begin them in one order.
class C10dCommunicator : public Communicator {
 public:
  /// See join_ranks(). @pre environment.size > 1
  C10dCommunicator(const LaunchEnvironment& environment, const RankOptions& options);
  ~C10dCommunicator() override;

  int rank() const override { return rank_; }
  int size() const override { return size_; }
  std::string description() const override { return description_; }
  std::unique_ptr<PendingSum> start_sum(torch::Tensor flat) override;
  std::int64_t sum_bytes() const override;
  void broadcast(torch::Tensor flat) override;
  std::vector<std::string> gather(const std::string& bytes) override;
  void barrier() override { gather(""); }
  void report(std::int64_t step, Activity activity) override { watchdog_->report(step, activity); }
  void leave(const std::string& reason) noexcept override;

 private:
  using WorkPtr = decltype(std::declval<ProcessGroup&>().barrier());
  struct Group;  // Gloo's, without time limits of its own
  class PendingWork;
  class PendingJob;

  void connect(const LaunchEnvironment& environment, const RankOptions& options);
  void finish(const WorkPtr& work);
  void stop_if_broken() const;
  bool sums_on_device(const torch::Tensor& tensor) const;
  WorkPtr start_plain(torch::Tensor& flat);
  void sum_rounded(torch::Tensor flat);
  std::vector<torch::Tensor> gather_equal(const torch::Tensor& own);

  int rank_, size_;
  std::string description_;
  std::atomic<bool> broken_{false};
  c10::intrusive_ptr<Group> gloo_;
  c10::intrusive_ptr<ProcessGroup> nccl_;  // null without
  std::unique_ptr<Watchdog> watchdog_;
  std::unique_ptr<SerialThread> rounded_sums_;  // null: gradients travel as they are
};

}  // namespace anigen::train
#endif
