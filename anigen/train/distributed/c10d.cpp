#include "anigen/train/distributed/launch.h"

// The only place that includes headers of c10d, LibTorch's library for several processes, and knows what it was built
// with: there must be Gloo to talk through, whose headers c10d's need (Debian: libgloo-dev).
#if defined(USE_C10D_GLOO) && defined(ANIGEN_WITH_GLOO) && __has_include(<gloo/context.h>)
#define ANIGEN_HAS_C10D 1
#include <arpa/inet.h>
#include <netdb.h>
#include <sys/socket.h>
#include <unistd.h>

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
#else
#define ANIGEN_HAS_C10D 0
#endif

#if ANIGEN_HAS_C10D
#include <algorithm>
#include <atomic>
#include <chrono>
#include <condition_variable>
#include <csignal>
#include <cstdlib>
#include <cstring>
#include <deque>
#include <functional>
#include <future>
#include <mutex>
#include <sstream>
#include <thread>

#include "anigen/core/error.h"
#include "anigen/core/process.h"
#include "anigen/train/distributed/watchdog.h"

namespace anigen::train {

namespace {

// State that the process groups of one library share.
#if ANIGEN_TORCH_AT_LEAST(2, 0)
using ProcessGroup = c10d::Backend;
#else
using ProcessGroup = c10d::ProcessGroup;
#endif
using StorePtr = c10::intrusive_ptr<c10d::Store>;
using Clock = Watchdog::Clock;
using std::chrono::milliseconds;

constexpr double kStartPatience = 10.0;                  // timeouts within which all ranks must have been started
constexpr milliseconds kForGood{7L * 24 * 3600 * 1000};  // the watchdog decides how long to wait, not Gloo
// A sum of Gloo's keeps at most two segments of 1 MiB on their way, too few for a link with delay.
constexpr std::size_t kSumsAtOnce = 6;
constexpr std::int64_t kGlooSumBytes = std::int64_t{4} << 20;
constexpr milliseconds kBetweenChecks{1000}, kBetweenLooks{1};

std::string first_line(const std::string& text) { return text.substr(0, text.find('\n')); }

// A thread that does jobs one after another, in the order in which they were given.
class SerialThread {
 public:
  SerialThread() : thread_([this] { work(); }) {}
  // Waits for the jobs that were given.
  ~SerialThread() {
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      stop_ = true;
    }
    given_.notify_one();
    thread_.join();
  }
  SerialThread(const SerialThread&) = delete;
  SerialThread& operator=(const SerialThread&) = delete;

  // Ready when the job is done; holds what it threw.
  std::future<void> give(std::function<void()> job) {
    std::packaged_task<void()> task(std::move(job));
    std::future<void> done = task.get_future();
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      jobs_.push_back(std::move(task));
    }
    given_.notify_one();
    return done;
  }

 private:
  void work() {
    std::unique_lock<std::mutex> lock(mutex_);
    for (;;) {
      given_.wait(lock, [this] { return stop_ || !jobs_.empty(); });
      if (jobs_.empty()) return;
      std::packaged_task<void()> job = std::move(jobs_.front());
      jobs_.pop_front();
      lock.unlock();
      job();
      lock.lock();
    }
  }

  std::mutex mutex_;
  std::condition_variable given_;
  std::deque<std::packaged_task<void()>> jobs_;
  bool stop_ = false;
  std::thread thread_;
};

// The store as keys. Its reads do not wait for a value.
class StoreKeys : public SharedKeys {
 public:
  explicit StoreKeys(StorePtr store) : store_(std::move(store)) {}

  void set(const std::string& key, const std::string& value) override {
    store_->set(key, std::vector<std::uint8_t>(value.begin(), value.end()));
  }
  std::optional<std::string> find(const std::string& key) override {
    if (!store_->check({key})) return std::nullopt;
    const std::vector<std::uint8_t> value = store_->get(key);
    return std::string(value.begin(), value.end());
  }
  std::int64_t add(const std::string& key, std::int64_t amount) override { return store_->add(key, amount); }

 private:
  StorePtr store_;
};

StorePtr plain_store(const Rendezvous& rendezvous, bool serve, std::chrono::milliseconds timeout) {
  if (!rendezvous.file.empty()) {
    constexpr int kNeverRemove = -1;  // whoever named the file removes it
    return c10::make_intrusive<c10d::FileStore>(rendezvous.file, kNeverRemove);
  }
  c10d::TCPStoreOptions options;
  options.port = static_cast<std::uint16_t>(rendezvous.port);
  options.isServer = serve && !rendezvous.served;
  options.waitWorkers = false;  // who is missing is found out later, by name
  options.timeout = timeout;
  return c10::make_intrusive<c10d::TCPStore>(rendezvous.host, options);
}

// Opens the rendezvous; keys carry its attempt. Waits until it is there. Where `serve` is set, this process keeps the
// values of a TCP rendezvous, unless the launcher does.
StorePtr open_store(const Rendezvous& rendezvous, bool serve, std::chrono::milliseconds timeout) {
  try {
    StorePtr store = plain_store(rendezvous, serve, timeout);
    store->setTimeout(timeout);
    return c10::make_intrusive<c10d::PrefixStore>("anigen" + rendezvous.attempt, store);
  } catch (const std::exception& problem) {
    throw Error("the rendezvous " + rendezvous.text() + " cannot be " + (serve ? "opened: " : "reached: ") +
                first_line(problem.what()));
  }
}

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

// The address of this machine on the way to a host; "" when there is no way. Debian gives a machine's own name the
// address 127.0.1.1, which Gloo would tell the other machines. Connecting a datagram socket sends nothing.
std::string address_towards(const std::string& host, int port) {
  addrinfo hints{};
  hints.ai_socktype = SOCK_DGRAM;
  addrinfo* found = nullptr;
  if (::getaddrinfo(host.c_str(), std::to_string(port).c_str(), &hints, &found) != 0) return "";
  std::string address;
  for (const addrinfo* each = found; each != nullptr && address.empty(); each = each->ai_next) {
    const int socket = ::socket(each->ai_family, SOCK_DGRAM, 0);
    if (socket < 0) continue;
    sockaddr_storage own{};
    socklen_t size = sizeof own;
    char text[NI_MAXHOST];
    if (::connect(socket, each->ai_addr, each->ai_addrlen) == 0 &&
        ::getsockname(socket, reinterpret_cast<sockaddr*>(&own), &size) == 0 &&
        ::getnameinfo(reinterpret_cast<sockaddr*>(&own), size, text, sizeof text, nullptr, 0, NI_NUMERICHOST) == 0) {
      address = text;
    }
    ::close(socket);
  }
  ::freeaddrinfo(found);
  return address.rfind("127.", 0) == 0 ? "" : address;
}

// The network devices, and in words what they are.
struct GlooDevices {
  std::vector<std::shared_ptr<::gloo::transport::Device>> devices;
  std::string description;
};

GlooDevices find_gloo_devices(const Rendezvous& rendezvous, bool local) {
  GlooDevices found;
  if (const char* interfaces = std::getenv("GLOO_SOCKET_IFNAME"); interfaces != nullptr && *interfaces != '\0') {
    std::istringstream names(interfaces);
    for (std::string name; std::getline(names, name, ',');) {
      try {
        found.devices.push_back(c10d::ProcessGroupGloo::createDeviceForInterface(name));
      } catch (const std::exception&) {
        throw InputError("GLOO_SOCKET_IFNAME", name.substr(0, 80), "this machine has no such network interface");
      }
    }
    found.description = interfaces;
    return found;
  }
  const std::string towards =
      local ? "127.0.0.1" : (rendezvous.host.empty() ? "" : address_towards(rendezvous.host, rendezvous.port));
  found.devices.push_back(towards.empty() ? c10d::ProcessGroupGloo::createDefaultDevice()
                                          : c10d::ProcessGroupGloo::createDeviceForHostname(towards));
  found.description = towards.empty() ? "the address of " + this_process().host : towards;
  return found;
}

// Ranks that talk through c10d: everything on a CPU through Gloo, sums of tensors on a GPU through NCCL where it is
// there, else through Gloo by way of the CPU.
//
// Gloo sums in a ring, which leaves the same bits everywhere. It has no bf16; such a sum is made of two exchanges with
// the volume of a ring: every rank gets its part of all tensors in bf16, sums it in fp32, and sends the sum in bf16 to
// all. These run on a thread of their own, as every other sum does then, since all ranks must begin them in one order.
class C10dCommunicator : public Communicator {
 public:
  // See join_ranks(). @pre environment.size > 1
  C10dCommunicator(const LaunchEnvironment& environment, const RankOptions& options)
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
  ~C10dCommunicator() override {
    rounded_sums_.reset();
    watchdog_.reset();
    if (!broken_) return;
    // Threads of these may wait for good for a rank that is gone, and their destructors for the threads.
    static_cast<void>(gloo_.release());
    static_cast<void>(nccl_.release());
  }

  int rank() const override { return rank_; }
  int size() const override { return size_; }
  std::string description() const override { return description_; }
  std::unique_ptr<PendingSum> start_sum(torch::Tensor flat) override {
    if (!rounded_sums_) return std::make_unique<PendingWork>(*this, std::move(flat));
    return std::make_unique<PendingJob>(rounded_sums_->give([this, flat] {
      if (flat.scalar_type() == torch::kFloat32) {
        sum_rounded(flat);
      } else {
        PendingWork(*this, flat).wait();
      }
    }));
  }
  std::int64_t sum_bytes() const override { return nccl_ ? Communicator::sum_bytes() : kGlooSumBytes; }
  void broadcast(torch::Tensor flat) override {
    const torch::NoGradGuard no_grad;
    torch::Tensor sent = flat.to(torch::kCPU);
    std::vector<torch::Tensor> tensors{sent};
    finish(gloo_->broadcast(tensors));
    if (!sent.is_same(flat)) flat.copy_(sent);
  }
  std::vector<std::string> gather(const std::string& bytes) override {
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
    for (std::size_t rank = 0; rank < result.size(); ++rank)
      std::memcpy(result[rank].data(), gathered[rank].data_ptr(), result[rank].size());
    return result;
  }
  void barrier() override { gather(""); }
  void report(std::int64_t step, Activity activity) override { watchdog_->report(step, activity); }
  void leave(const std::string& reason) noexcept override {
    broken_ = true;
    watchdog_->leave(reason);
  }

 private:
  using WorkPtr = decltype(std::declval<ProcessGroup&>().barrier());
  // Gloo's, without time limits of its own.
  struct Group : c10d::ProcessGroupGloo {
    using ProcessGroupGloo::ProcessGroupGloo;
    void wait_for_good() {
      for (const auto& context : contexts_) context->setTimeout(kForGood);
    }
  };

  class PendingWork : public PendingSum {
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

  class PendingJob : public PendingSum {
   public:
    explicit PendingJob(std::future<void> done) : done_(std::move(done)) {}
    void wait() override { done_.get(); }

   private:
    std::future<void> done_;
  };

  void connect(const LaunchEnvironment& environment, const RankOptions& options) {
    const milliseconds patience(static_cast<std::int64_t>(1000.0 * kStartPatience * options.timeout));
    const Rendezvous& rendezvous = environment.rendezvous;
    const StorePtr store = open_store(rendezvous, rank_ == 0, patience);
    // A connection of its own: in the other one a call may wait for a value.
    const std::shared_ptr<SharedKeys> keys = std::make_shared<StoreKeys>(open_store(rendezvous, false, patience));
    const std::vector<std::string> networks = meet(*keys, environment, patience);
    const bool local =
        std::all_of(networks.begin(), networks.end(), [&](const auto& each) { return each == networks.front(); });

    const GlooDevices devices = find_gloo_devices(rendezvous, local);
    auto gloo_options = c10d::ProcessGroupGloo::Options::create(patience);
    gloo_options->devices = devices.devices;
    gloo_options->threads = static_cast<int>(kSumsAtOnce * devices.devices.size());
    gloo_ =
        c10::make_intrusive<Group>(c10::make_intrusive<c10d::PrefixStore>("gloo", store), rank_, size_, gloo_options);
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
  void finish(const WorkPtr& work) {
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

  // Jobs of another thread must end when this rank leaves.
  void stop_if_broken() const {
    if (broken_) throw RankLost("this rank has left the others");
  }
  bool sums_on_device(const torch::Tensor& tensor) const { return tensor.is_cpu() || (nccl_ && tensor.is_cuda()); }
  WorkPtr start_plain(torch::Tensor& flat) {
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
  void sum_rounded(torch::Tensor flat) {
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
  std::vector<torch::Tensor> gather_equal(const torch::Tensor& own) {
    std::vector<std::vector<torch::Tensor>> all(1);
    for (int rank = 0; rank < size_; ++rank) all.front().push_back(torch::empty_like(own));
    std::vector<torch::Tensor> input{own};
    finish(gloo_->allgather(all, input));
    return all.front();
  }

  int rank_, size_;
  std::string description_;
  std::atomic<bool> broken_{false};
  c10::intrusive_ptr<Group> gloo_;
  c10::intrusive_ptr<ProcessGroup> nccl_;  // null without
  std::unique_ptr<Watchdog> watchdog_;
  std::unique_ptr<SerialThread> rounded_sums_;  // null: gradients travel as they are
};
}  // namespace

std::shared_ptr<Communicator> make_c10d(const LaunchEnvironment& environment, const RankOptions& options) {
  return std::make_shared<C10dCommunicator>(environment, options);
}

}  // namespace anigen::train

#else

namespace anigen::train {

std::shared_ptr<Communicator> make_c10d(const LaunchEnvironment&, const RankOptions&) { return nullptr; }

}  // namespace anigen::train

#endif
