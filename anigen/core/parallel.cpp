#include "anigen/core/parallel.h"

#include <tbb/global_control.h>
#include <tbb/parallel_for.h>

#include <memory>

#include "anigen/core/cores.h"

namespace anigen {
namespace {

int cores_to_use() { return default_thread_count(find_cores()); }

int& count_setting() {
  static int count = cores_to_use();
  return count;
}

}  // namespace

void set_thread_count(int threads) {
  static std::unique_ptr<tbb::global_control> control;
  count_setting() = threads > 0 ? threads : cores_to_use();
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
