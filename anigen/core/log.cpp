#include "anigen/core/log.h"

#include <spdlog/sinks/basic_file_sink.h>
#include <spdlog/sinks/stdout_color_sinks.h>
#include <unistd.h>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <memory>
#include <set>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/job.h"

#if defined(__GLIBC__)
#include <malloc.h>
#endif

namespace anigen::log {

void setup(const std::string& level) {
  const std::set<std::string> levels = {"debug", "info", "warn", "error", "off"};
  if (levels.count(level) == 0)
    throw InputError("", "--log-level", "unknown level '" + level + "'; use debug, info, warn, error or off");
  auto sink = std::make_shared<spdlog::sinks::stderr_color_sink_mt>();
  sink->set_pattern("%^[%l]%$ %v");
  auto logger = std::make_shared<spdlog::logger>("anigen", sink);
  logger->set_level(spdlog::level::from_str(level));
  spdlog::set_default_logger(logger);
}

void also_to_file(const std::filesystem::path& file) {
  auto sink = std::make_shared<spdlog::sinks::basic_file_sink_mt>(file.string());
  sink->set_pattern("%Y-%m-%d %H:%M:%S [%l] %v");
  spdlog::default_logger()->sinks().push_back(sink);
  spdlog::default_logger()->flush_on(spdlog::level::info);
}

void warn_once(const std::string& message) {
  static std::mutex mutex;
  static std::set<std::string> said;
  const std::lock_guard<std::mutex> lock(mutex);
  if (said.insert(message).second) spdlog::warn("{}", message);
}

}  // namespace anigen::log

namespace anigen {

namespace {

bool quiet_setting = false;

std::string duration(double seconds) {
  char text[32];
  const long s = std::lround(seconds);
  if (s >= 3600)
    std::snprintf(text, sizeof text, "%ldh%02ldm", s / 3600, s / 60 % 60);
  else
    std::snprintf(text, sizeof text, "%ldm%02lds", s / 60, s % 60);
  return text;
}

}  // namespace

void Progress::set_quiet(bool quiet) { quiet_setting = quiet; }

Progress::Progress(std::string label, std::size_t total, std::string unit)
    : label_(std::move(label)),
      unit_(std::move(unit)),
      total_(total),
      started_(std::chrono::steady_clock::now()),
      drawn_(started_) {}

void Progress::start_at(std::size_t done) {
  const std::lock_guard<std::mutex> lock(mutex_);
  first_ = done_ = done;
}

void Progress::note(std::string text) {
  const std::lock_guard<std::mutex> lock(mutex_);
  note_ = std::move(text);
}

void Progress::advance(std::size_t steps) {
  const std::lock_guard<std::mutex> lock(mutex_);
  done_ += steps;
  const double since = std::chrono::duration<double>(std::chrono::steady_clock::now() - drawn_).count();
  const double between = current_job() != nullptr ? 0.05 : ::isatty(STDERR_FILENO) != 0 ? 0.2 : 10.0;
  if (since >= between) draw(false);
}

void Progress::finish() {
  const std::lock_guard<std::mutex> lock(mutex_);
  if (finished_) return;
  finished_ = true;
  draw(true);
}

void Progress::draw(bool last) {
  if (Job* job = current_job()) {
    drawn_ = std::chrono::steady_clock::now();
    return job->report(label_, last || total_ == 0 ? 1.0 : static_cast<double>(done_) / static_cast<double>(total_));
  }
  if (quiet_setting) return;
  drawn_ = std::chrono::steady_clock::now();
  const double elapsed = std::chrono::duration<double>(drawn_ - started_).count();
  const double rate = static_cast<double>(done_ - first_) / std::max(elapsed, 1e-9);
  const double fraction = total_ > 0 ? std::min(1.0, static_cast<double>(done_) / static_cast<double>(total_)) : 1.0;
  const std::string left =
      last || rate <= 0.0 ? ""
                          : ", " + duration(static_cast<double>(total_ - std::min(done_, total_)) / rate) + " left";
  const bool terminal = ::isatty(STDERR_FILENO) != 0;
  std::string bar;
  if (terminal) {
    const auto filled = static_cast<std::size_t>(fraction * 28.0);
    bar = " [" + std::string(filled, '#') + std::string(28 - filled, '.') + "]";
  }
  std::fprintf(stderr, "%s%s%s %3.0f %% %zu/%zu %s, %.3g/s, %s%s%s%s%s", terminal ? "\r" : "", label_.c_str(),
               bar.c_str(), 100.0 * fraction, done_, total_, unit_.c_str(), rate, duration(elapsed).c_str(),
               left.c_str(), note_.empty() ? "" : ", ", note_.c_str(),
               terminal ? (last ? "\033[K\n" : "\033[K") : "\n");
  std::fflush(stderr);
}

void keep_freed_memory() {
#if defined(__GLIBC__)
  // One heap for all threads: those of other threads are small and go back to the system with every large tensor.
  ::mallopt(M_ARENA_MAX, 1);
  ::mallopt(M_MMAP_THRESHOLD, 1 << 28);
  ::mallopt(M_TRIM_THRESHOLD, std::numeric_limits<int>::max());  // attention of 65 thousand voxels frees 0.8 GB at once
#endif
}

void release_freed_memory() {
#if defined(__GLIBC__)
  ::malloc_trim(0);
#endif
}

}  // namespace anigen
