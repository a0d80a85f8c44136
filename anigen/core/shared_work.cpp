#include "anigen/core/shared_work.h"

#include <algorithm>
#include <chrono>
#include <mutex>
#include <thread>

#include "anigen/core/interrupt.h"
#include "anigen/core/log.h"

namespace anigen {
namespace {

using namespace std::chrono_literals;

/// Longer and longer, so that many who wait for one do not keep the file system busy.
class Patience {
 public:
  void reset() { pause_ = kShortest; }
  void wait() {
    if (pause_ == kShortest) log::info("waiting for other processes, which have what is left of the work");
    for (auto left = pause_; left > 0ms; left -= kShortest) {
      throw_if_interrupted();
      std::this_thread::sleep_for(kShortest);
    }
    pause_ = std::min(pause_ * 2, kLongest);
  }

 private:
  static constexpr std::chrono::milliseconds kShortest = 50ms, kLongest = 3200ms;
  std::chrono::milliseconds pause_ = kShortest;
};

}  // namespace

void work_together(const LeaseFolder& leases, const std::vector<std::string>& names,
                   const std::function<bool(std::size_t)>& done, const WorkPass& pass) {
  std::vector<std::size_t> left;
  for (std::size_t i = 0; i < names.size(); ++i) left.push_back(i);
  std::vector<char> ours(names.size(), 0);
  std::mutex mutex;
  Patience patience;
  for (;;) {
    throw_if_interrupted();
    left.erase(std::remove_if(left.begin(), left.end(), [&](std::size_t i) { return ours[i] != 0 || done(i); }),
               left.end());
    if (left.empty()) return;
    bool any = false;
    pass(left, [&](std::size_t piece) -> std::optional<Lease> {
      if (done(piece)) return std::nullopt;
      std::optional<Lease> lease = leases.try_take(names[piece]);
      if (!lease) return std::nullopt;
      const std::lock_guard<std::mutex> lock(mutex);
      any = true;
      if (done(piece)) return std::nullopt;  // while we were taking it
      ours[piece] = 1;
      return lease;
    });
    any ? patience.reset() : patience.wait();
  }
}

void work_in_turn(const LeaseFolder& leases, const std::vector<std::string>& names,
                  const std::function<bool(std::size_t)>& done, const std::function<void(std::size_t)>& work) {
  work_together(leases, names, done, [&](const std::vector<std::size_t>& pieces, const Claim& claim) {
    for (const std::size_t piece : pieces) {
      throw_if_interrupted();
      const std::optional<Lease> lease = claim(piece);
      if (lease) work(piece);
    }
  });
}

}  // namespace anigen
