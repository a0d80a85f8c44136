#pragma once
#include <benchmark/benchmark.h>

#include <algorithm>
#include <cstdio>
#include <map>
#include <string>
#include <utility>
#include <vector>

namespace anigen::benchmarks {

/// Prints rows as usual and remembers the fastest repetition of each by one of its counters, for ratios between rows.
class RatioReporter : public benchmark::ConsoleReporter {
 public:
  /// @param counter a rate, such as "votes_per_second"
  explicit RatioReporter(std::string counter) : counter_(std::move(counter)) {}

  void ReportRuns(const std::vector<Run>& runs) override {
    ConsoleReporter::ReportRuns(runs);
    for (const Run& run : runs) {
      if (run.run_type != Run::RT_Iteration || was_left_out(run, 0)) continue;
      const auto found = run.counters.find(counter_);
      if (found == run.counters.end()) continue;
      double& best = best_[run.run_name.function_name];
      best = std::max(best, found->second.value);
    }
  }

  /// Speed of row a relative to row b; nothing when one of them has not run.
  void print_ratio(const std::string& what, const std::string& a, const std::string& b) const {
    const auto first = best_.find(a), second = best_.find(b);
    if (first == best_.end() || second == best_.end()) return;
    std::printf("%-64s %8.2f\n", what.c_str(), first->second / second->second);
  }

 private:
  // Google Benchmark 1.8 has `skipped` in place of `error_occurred`.
  template <typename AnyRun>
  static auto was_left_out(const AnyRun& run, int) -> decltype(static_cast<bool>(run.error_occurred)) {
    return run.error_occurred;
  }
  template <typename AnyRun>
  static bool was_left_out(const AnyRun& run, long) {
    return static_cast<bool>(run.skipped);
  }

  std::string counter_;
  std::map<std::string, double> best_;
};

}  // namespace anigen::benchmarks
