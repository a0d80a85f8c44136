#include "anigen/train/distributed/c10d_communicator.h"

#if ANIGEN_HAS_C10D
#include <algorithm>
#include <csignal>
#include <cstring>
#include <thread>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/interrupt.h"
#include "anigen/core/process_identity.h"
#include "anigen/train/distributed/c10d_store.h"
#include "anigen/train/distributed/gloo_devices.h"

namespace anigen::train {
namespace {

using Clock = Watchdog::Clock;
using std::chrono::milliseconds;

constexpr double kStartPatience = 10.0;                  // timeouts within which all ranks must have been started
constexpr milliseconds kForGood{7L * 24 * 3600 * 1000};  // the watchdog decides how long to wait, not Gloo
// A sum of Gloo's keeps at most two segments of 1 MiB on their way, too few for a link with delay.
constexpr std::size_t kSumsAtOnce = 6;
constexpr std::int64_t kGlooSumBytes = std::int64_t{4} << 20;
constexpr milliseconds kBetweenChecks{1000}, kBetweenLooks{1};

std::string first_line(const std::string& text) { return text.substr(0, text.find('\n')); }

// Waits until every rank has said where it runs. @return their network_space()s, by rank
std::vector<std::string> meet(SharedKeys& keys, const LaunchEnvironment& environment, milliseconds patience) {
  if (keys.add("joined/" + std::to_string(environment.rank), 1) != 1) {
    throw Error("the rendezvous " + environment.rendezvous.text() + " already has a rank " +
                std::to_string(environment.rank) + ": an earlier run left it, or two were started; name another one");
  }
  keys.set("network/" + std::to_string(environment.rank), network_space());
  std::vector<std::string> networks;
  const Clock::time_point until = Clock::now() + patience;
  while (static_cast<int>(networks.size()) < environment.size) {
    const std::string next = std::to_string(networks.size());
    if (const auto network = keys.find("network/" + next)) {
      networks.push_back(*network);
      continue;
    }
    if (Clock::now() > until) {
      throw Error("rank " + next + " of " + std::to_string(environment.size) + " did not come to " +
                  environment.rendezvous.text() + " within " + std::to_string(patience.count() / 1000) + " s");
    }
    throw_if_interrupted();
    std::this_thread::sleep_for(milliseconds(20));
  }
  return networks;
}

}  // namespace

struct C10dCommunicator::Group : c10d::ProcessGroupGloo {
  using ProcessGroupGloo::ProcessGroupGloo;
  void wait_for_good() {
    for (const auto& context : contexts_) context->setTimeout(kForGood);
  }
};

class C10dCommunicator::PendingWork : public PendingSum {
 public:
  PendingWork(C10dCommunicator& owner, torch::Tensor flat) : owner_(owner), flat_(std::move(flat)) {
    summed_ = owner_.sums_on_device(flat_) ? flat_ : flat_.to(torch::kCPU);
    work_ = owner_.start_plain(summed_);
  }
  void wait() override {
    owner_.finish(work_);
    if (!summed_.is_same(flat_)) flat_.copy_(summed_);
  }

 private:
  C10dCommunicator& owner_;
  torch::Tensor flat_, summed_;
  WorkPtr work_;
};

class C10dCommunicator::PendingJob : public PendingSum {
 public:
  explicit PendingJob(std::future<void> done) : done_(std::move(done)) {}
  void wait() override { done_.get(); }

 private:
  std::future<void> done_;
};

C10dCommunicator::C10dCommunicator(const LaunchEnvironment& environment, const RankOptions& options)
    : rank_(environment.rank), size_(environment.size) {
  std::signal(SIGPIPE, SIG_IGN);  // a broken connection is an error that names a rank, not the end of this process
  try {
    connect(environment, options);
  } catch (const Error&) {
    throw;
  } catch (const std::exception& problem) {  // of c10d or of Gloo
    throw Error("rank " + std::to_string(rank_) + " cannot connect to the others: " + first_line(problem.what()));
  }
  if (options.sent == torch::kBFloat16) rounded_sums_ = std::make_unique<SerialThread>();
  description_ += std::string(", gradients in ") + (rounded_sums_ ? "bf16" : "fp32");
}

void C10dCommunicator::connect(const LaunchEnvironment& environment, const RankOptions& options) {
  const milliseconds patience(static_cast<std::int64_t>(1000.0 * kStartPatience * options.timeout));
  const Rendezvous& rendezvous = environment.rendezvous;
  const StorePtr store = open_store(rendezvous, rank_ == 0, patience);
  // A connection of its own: in the other one a call may wait for a value.
  const std::shared_ptr<SharedKeys> keys = keys_of(open_store(rendezvous, false, patience));
  const std::vector<std::string> networks = meet(*keys, environment, patience);
  const bool local = std::all_of(networks.begin(), networks.end(), [&](const auto& each) { return each == networks.front(); });

  const GlooDevices devices = find_gloo_devices(rendezvous, local);
  auto gloo_options = c10d::ProcessGroupGloo::Options::create(patience);
  gloo_options->devices = devices.devices;
  gloo_options->threads = static_cast<int>(kSumsAtOnce * devices.devices.size());
  gloo_ = c10::make_intrusive<Group>(c10::make_intrusive<c10d::PrefixStore>("gloo", store), rank_, size_, gloo_options);
  gloo_->wait_for_good();
  description_ = "Gloo over " + devices.description;
#if ANIGEN_HAS_NCCL
  if (torch::cuda::is_available()) {
    nccl_ = c10::make_intrusive<c10d::ProcessGroupNCCL>(c10::make_intrusive<c10d::PrefixStore>("nccl", store), rank_,
                                                        size_);
    description_ += ", NCCL";
  }
#endif
  Watchdog::Options watching;
  watching.rank = rank_;
  watching.size = size_;
  watching.timeout = Watchdog::Seconds(options.timeout);
  if (rendezvous.file.empty()) watching.keeper = rendezvous.served ? "the launcher" : "rank 0";
  watching.keeps = rank_ == 0 && rendezvous.file.empty() && !rendezvous.served;
  watchdog_ = std::make_unique<Watchdog>(keys, watching);
}

C10dCommunicator::~C10dCommunicator() {
  rounded_sums_.reset();
  watchdog_.reset();
  if (!broken_) return;
  // Threads of these may wait for good for a rank that is gone, and their destructors for the threads.
  static_cast<void>(gloo_.release());
  static_cast<void>(nccl_.release());
}

void C10dCommunicator::leave(const std::string& reason) noexcept {
  broken_ = true;
  watchdog_->leave(reason);
}

void C10dCommunicator::finish(const WorkPtr& work) {
  const Clock::time_point since = Clock::now();
  Clock::time_point checked = since;
  bool watched = false;
  try {
    while (!work->isCompleted()) {
      stop_if_broken();
      if (nccl_) {
        std::this_thread::sleep_for(
            kBetweenLooks);  // what wait() of NCCL waits for is the stream's order, not the work
      } else {
        try {
          work->wait(kBetweenChecks);
        } catch (const std::exception&) {
          // Out of time, or the work failed: which of them, the work says itself.
        }
      }
      if (work->isCompleted() || Clock::now() - checked < kBetweenChecks / 2) continue;
      checked = Clock::now();
      watched = true;
      watchdog_->check(since);
    }
    if (watched) watchdog_->done_waiting();
    work->wait();
  } catch (const RankLost&) {
    broken_ = true;
    throw;
  } catch (const std::exception& problem) {
    broken_ = true;
    watchdog_->explain(first_line(problem.what()));
  }
}

bool C10dCommunicator::sums_on_device(const torch::Tensor& tensor) const {
  return tensor.is_cpu() || (nccl_ && tensor.is_cuda());
}

// Jobs of another thread must end when this rank leaves.
void C10dCommunicator::stop_if_broken() const {
  if (broken_) throw RankLost("this rank has left the others");
}

C10dCommunicator::WorkPtr C10dCommunicator::start_plain(torch::Tensor& flat) {
  stop_if_broken();
  std::vector<torch::Tensor> tensors{flat};
  try {
    if (nccl_ && flat.is_cuda()) return nccl_->allreduce(tensors);
    return gloo_->allreduce(tensors);
  } catch (const std::exception& problem) {
    broken_ = true;
    watchdog_->explain(first_line(problem.what()));
  }
}

std::unique_ptr<PendingSum> C10dCommunicator::start_sum(torch::Tensor flat) {
  if (!rounded_sums_) return std::make_unique<PendingWork>(*this, std::move(flat));
  return std::make_unique<PendingJob>(rounded_sums_->give([this, flat] {
    if (flat.scalar_type() == torch::kFloat32) {
      sum_rounded(flat);
    } else {
      PendingWork(*this, flat).wait();
    }
  }));
}

void C10dCommunicator::sum_rounded(torch::Tensor flat) {
  const torch::NoGradGuard no_grad;
  if (nccl_ && flat.is_cuda()) {
    torch::Tensor rounded = flat.to(torch::kBFloat16);
    finish(start_plain(rounded));
    flat.copy_(rounded);
    return;
  }
  const std::int64_t count = flat.numel(), part = (count + size_ - 1) / size_;
  // Gloo moves bytes; parts are as long as the longest, filled up with zeros.
  torch::Tensor sent = torch::zeros({size_ * part}, torch::kBFloat16), received = torch::empty_like(sent);
  sent.narrow(0, 0, count).copy_(flat);
  torch::Tensor out = received.view(torch::kUInt8), in = sent.view(torch::kUInt8);
  std::vector<std::int64_t> equal_out, equal_in;
  finish(gloo_->alltoall_base(out, in, equal_out, equal_in));
  const torch::Tensor own = received.view({size_, part}).to(torch::kFloat32).sum(0).to(torch::kBFloat16);
  const std::vector<torch::Tensor> parts = gather_equal(own.view(torch::kUInt8));
  flat.copy_(torch::cat(parts).view(torch::kBFloat16).narrow(0, 0, count));
}

std::vector<torch::Tensor> C10dCommunicator::gather_equal(const torch::Tensor& own) {
  std::vector<std::vector<torch::Tensor>> all(1);
  for (int rank = 0; rank < size_; ++rank) all.front().push_back(torch::empty_like(own));
  std::vector<torch::Tensor> input{own};
  finish(gloo_->allgather(all, input));
  return all.front();
}

std::int64_t C10dCommunicator::sum_bytes() const { return nccl_ ? Communicator::sum_bytes() : kGlooSumBytes; }

void C10dCommunicator::broadcast(torch::Tensor flat) {
  const torch::NoGradGuard no_grad;
  torch::Tensor sent = flat.to(torch::kCPU);
  std::vector<torch::Tensor> tensors{sent};
  finish(gloo_->broadcast(tensors));
  if (!sent.is_same(flat)) flat.copy_(sent);
}

std::vector<std::string> C10dCommunicator::gather(const std::string& bytes) {
  const torch::NoGradGuard no_grad;
  const auto lengths = gather_equal(torch::full({1}, static_cast<std::int64_t>(bytes.size()), torch::kInt64));
  std::vector<std::string> result;
  std::int64_t longest = 0;
  for (const torch::Tensor& length : lengths) {
    result.emplace_back(static_cast<std::size_t>(length.item<std::int64_t>()), '\0');
    longest = std::max(longest, length.item<std::int64_t>());
  }
  if (longest == 0) return result;
  torch::Tensor own = torch::zeros({longest}, torch::kUInt8);
  std::memcpy(own.data_ptr(), bytes.data(), bytes.size());
  const auto gathered = gather_equal(own);
  for (std::size_t rank = 0; rank < result.size(); ++rank) {
    std::memcpy(result[rank].data(), gathered[rank].data_ptr(), result[rank].size());
  }
  return result;
}

}  // namespace anigen::train
#endif
