#pragma once
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "anigen/prepare/run/shard.h"
#include "anigen/prepare/steps/source_outcome.h"

namespace anigen::prepare {

/// What a step cost over all assets of a run.
struct StepCost {
  std::vector<double> seconds;
  std::uint64_t peak_bytes = 0;
};

/// run/timings-<i>-of-<n>-<process>.csv: id, variant, step, seconds, peak_mb, a line per step that this process did.
/// Not part of the dataset: two equal runs differ in it.
class TimingLog {
 public:
  /// @throws Error when the file cannot be written
  TimingLog(const std::filesystem::path& out, const Shard& shard);
  ~TimingLog();
  TimingLog(const TimingLog&) = delete;
  TimingLog& operator=(const TimingLog&) = delete;

  void add(const SourceOutcome& outcome);
  /// Of this run, by step.
  const std::map<std::string, StepCost>& costs() const { return costs_; }

 private:
  std::FILE* stream_ = nullptr;
  std::map<std::string, StepCost> costs_;
};

/// A table with assets, mean, median, 95th percentile, total seconds and peak memory per step; empty without steps.
std::string to_text(const std::map<std::string, StepCost>& costs);
Json to_json(const std::map<std::string, StepCost>& costs);

}  // namespace anigen::prepare
