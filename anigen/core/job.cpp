#include "anigen/core/job.h"

#include <algorithm>

namespace anigen {

namespace {

thread_local Job* current = nullptr;

}  // namespace

void Job::report(const std::string& stage, double fraction) noexcept {
  if (!watch_) return;
  try {
    const std::lock_guard<std::mutex> lock(mutex_);
    watch_(stage, std::clamp(fraction, 0.0, 1.0));
  } catch (...) {
    cancel();
  }
}

JobScope::JobScope(Job* job) : before_(current) { current = job; }

JobScope::~JobScope() { current = before_; }

Job* current_job() { return current; }

}  // namespace anigen
