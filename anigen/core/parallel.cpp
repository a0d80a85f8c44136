#include "anigen/core/parallel.h"

#include <sched.h>
#include <tbb/global_control.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <memory>
#include <thread>

namespace anigen {
namespace {

/// Those this process may run on: a batch system gives a job a few of a machine's.
int available_cores() {
  cpu_set_t set;
  if (::sched_getaffinity(0, sizeof set, &set) == 0) return std::max(1, CPU_COUNT(&set));
  return std::max(1, static_cast<int>(std::thread::hardware_concurrency()));  // more than a cpu_set_t holds
}

int& count_setting() {
  static int count = available_cores();
  return count;
}

}  // namespace

void set_thread_count(int threads) {
  static std::unique_ptr<tbb::global_control> control;
  count_setting() = threads > 0 ? threads : available_cores();
  control = std::make_unique<tbb::global_control>(tbb::global_control::max_allowed_parallelism,
                                                  static_cast<std::size_t>(count_setting()));
}

int thread_count() { return count_setting(); }

void parallel_for(std::size_t n, const std::function<void(std::size_t)>& body) {
  if (thread_count() == 1 || n < 2) {
    for (std::size_t i = 0; i < n; ++i) body(i);
    return;
  }
  tbb::parallel_for(std::size_t{0}, n, [&](std::size_t i) { body(i); });
}

}  // namespace anigen
