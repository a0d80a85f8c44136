#include "anigen/experiment/estimate.h"

#include <cmath>
#include <cstdio>

#include "anigen/experiment/job_record.h"

namespace anigen::experiment {

Estimates::Estimates(const std::filesystem::path& out) {
  for (const std::string& id : recorded_jobs(out)) {
    const auto record = read_record(out, id);
    if (!record || record->state != JobRecord::State::kDone) continue;
    Sum& sum = by_step_[record->step];
    sum.seconds += record->seconds;
    sum.bytes += static_cast<double>(record->disk_bytes);
    ++sum.jobs;
    if (record->expected_seconds <= 0) continue;
    sum.stated += record->seconds;
    sum.expected += record->expected_seconds;
  }
}

double Estimates::seconds(const Job& job) const {
  const auto found = by_step_.find(job.step);
  const double stated = job.minutes * 60;
  if (found == by_step_.end()) return stated;
  const Sum& sum = found->second;
  // A sweep may train a step for a minute where another experiment of the same folder trained it for an hour.
  if (stated > 0 && sum.expected > 0) return stated * sum.stated / sum.expected;
  return sum.seconds / sum.jobs;
}

double Estimates::bytes(const Job& job) const {
  const auto found = by_step_.find(job.step);
  return found == by_step_.end() ? job.megabytes * 1e6 : found->second.bytes / found->second.jobs;
}

std::string duration_text(double seconds) {
  if (!(seconds > 0)) return "?";
  char text[40];
  const long whole = std::lround(seconds);
  if (whole < 60) {
    std::snprintf(text, sizeof text, "%ld s", std::max(1L, whole));
  } else if (whole < 3600) {
    std::snprintf(text, sizeof text, "%ld min %02ld s", whole / 60, whole % 60);
  } else {
    std::snprintf(text, sizeof text, "%ld h %02ld min", whole / 3600, whole / 60 % 60);
  }
  return text;
}

std::string size_text(double bytes) {
  if (!(bytes > 0)) return "?";
  constexpr double kGigabyte = 1e9, kMegabyte = 1e6;
  char text[40];
  if (bytes >= kGigabyte) {
    std::snprintf(text, sizeof text, "%.2f GB", bytes / kGigabyte);
  } else {
    std::snprintf(text, sizeof text, "%.1f MB", bytes / kMegabyte);
  }
  return text;
}

}  // namespace anigen::experiment
