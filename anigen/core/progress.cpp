#include "anigen/core/progress.h"

#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <utility>

namespace anigen {
namespace {

bool quiet_setting = false;

std::string duration(double seconds) {
  char text[32];
  const long s = static_cast<long>(seconds + 0.5);
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

Progress::~Progress() { finish(); }

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
  if (since >= (::isatty(STDERR_FILENO) ? 0.2 : 10.0)) draw(false);
}

void Progress::finish() {
  const std::lock_guard<std::mutex> lock(mutex_);
  if (finished_) return;
  finished_ = true;
  draw(true);
}

void Progress::draw(bool last) {
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

}  // namespace anigen
