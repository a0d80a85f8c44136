#pragma once
#include <atomic>
#include <chrono>
#include <condition_variable>
#include <deque>
#include <functional>
#include <future>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "anigen/nn/torch.h"
#include "anigen/train/distributed/communicator.h"
#include "anigen/train/distributed/launch.h"
#include "anigen/train/distributed/watchdog.h"

/// The only place that includes headers of c10d, LibTorch's library for several processes, and knows what it was built
/// with. ANIGEN_HAS_C10D is 1 when there is Gloo to talk through, whose headers c10d's need (Debian: libgloo-dev).

#if defined(USE_C10D_GLOO) && defined(ANIGEN_WITH_GLOO) && __has_include(<gloo/context.h>)
#define ANIGEN_HAS_C10D 1
#include <torch/csrc/distributed/c10d/FileStore.hpp>
#include <torch/csrc/distributed/c10d/PrefixStore.hpp>
#include <torch/csrc/distributed/c10d/ProcessGroupGloo.hpp>
#include <torch/csrc/distributed/c10d/TCPStore.hpp>
#if defined(USE_C10D_NCCL) && __has_include(<nccl.h>)
#define ANIGEN_HAS_NCCL 1
#include <torch/csrc/distributed/c10d/ProcessGroupNCCL.hpp>
#else
#define ANIGEN_HAS_NCCL 0
#endif

#if ANIGEN_HAS_C10D

#if ANIGEN_HAS_C10D

#if ANIGEN_HAS_C10D

namespace anigen::train {

/// State that the process groups of one library share.
#if ANIGEN_TORCH_AT_LEAST(2, 0)
using ProcessGroup = c10d::Backend;
#else
using ProcessGroup = c10d::ProcessGroup;
#endif

}  // namespace anigen::train

#else
#define ANIGEN_HAS_C10D 0
#endif

namespace anigen::train {

/// A thread that does jobs one after another, in the order in which they were given.
class SerialThread {
 public:
  SerialThread();
  /// Waits for the jobs that were given.
  ~SerialThread();
  SerialThread(const SerialThread&) = delete;
  SerialThread& operator=(const SerialThread&) = delete;

  /// @return ready when the job is done; holds what it threw
  std::future<void> give(std::function<void()> job);

 private:
  void work();

  std::mutex mutex_;
  std::condition_variable given_;
  std::deque<std::packaged_task<void()>> jobs_;
  bool stop_ = false;
  std::thread thread_;
};

using StorePtr = c10::intrusive_ptr<c10d::Store>;

/// Opens the rendezvous; keys carry its attempt. Waits until it is there.
/// @param serve rank 0's first: it keeps the values of a TCP rendezvous, unless the launcher does
/// @throws Error naming the rendezvous when it cannot be reached within `timeout`
StorePtr open_store(const Rendezvous& rendezvous, bool serve, std::chrono::milliseconds timeout);

/// The store as keys. Its reads do not wait for a value.
std::shared_ptr<SharedKeys> keys_of(StorePtr store);

}  // namespace anigen::train

#endif

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

namespace anigen::train {

/// The network devices of join_ranks(), and in words what they are.
struct GlooDevices {
  std::vector<std::shared_ptr<::gloo::transport::Device>> devices;
  std::string description;
};

/// @param local all ranks are on this machine @throws InputError for an interface that is not there
GlooDevices find_gloo_devices(const Rendezvous& rendezvous, bool local);

}  // namespace anigen::train

#endif
