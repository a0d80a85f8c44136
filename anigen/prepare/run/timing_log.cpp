#include "anigen/prepare/run/timing_log.h"

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <numeric>

#include "anigen/core/error.h"
#include "anigen/core/process_identity.h"
#include "anigen/prepare/run/run_lock.h"

namespace anigen::prepare {
namespace {

double megabytes(std::uint64_t bytes) { return static_cast<double>(bytes) / 1048576.0; }

struct Figures {
  double total = 0, mean = 0, median = 0, p95 = 0;
};

Figures figures(std::vector<double> seconds) {
  if (seconds.empty()) return {};
  std::sort(seconds.begin(), seconds.end());
  const double n = static_cast<double>(seconds.size());
  const auto at = [&](double share) { return seconds[static_cast<std::size_t>(share * (n - 1.0) + 0.5)]; };
  const double total = std::accumulate(seconds.begin(), seconds.end(), 0.0);
  return {total, total / n, at(0.5), at(0.95)};
}

}  // namespace

TimingLog::TimingLog(const std::filesystem::path& out, const Shard& shard) {
  const std::filesystem::path file = run_folder(out) / ("timings-" + shard.name() + "-" + process_number() + ".csv");
  stream_ = std::fopen(file.c_str(), "ae");
  if (stream_ == nullptr) throw Error(file.string() + ": cannot open: " + std::strerror(errno));
  std::fseek(stream_, 0, SEEK_END);
  if (std::ftell(stream_) == 0) std::fputs("id,variant,step,seconds,peak_mb\n", stream_);
}

TimingLog::~TimingLog() { std::fclose(stream_); }

void TimingLog::add(const SourceOutcome& outcome) {
  for (const AssetOutcome& asset : outcome.assets) {
    for (const StepTiming& timing : asset.timings) {
      std::fprintf(stream_, "%s,%zu,%s,%.4f,%.1f\n", asset.id.c_str(), asset.variant, timing.step.c_str(),
                   timing.seconds, megabytes(timing.peak_bytes));
      StepCost& cost = costs_[timing.step];
      cost.seconds.push_back(timing.seconds);
      cost.peak_bytes = std::max(cost.peak_bytes, timing.peak_bytes);
    }
  }
  std::fflush(stream_);
}

std::string to_text(const std::map<std::string, StepCost>& costs) {
  if (costs.empty()) return "";
  std::string text = "step                        assets    mean s  median s    95 % s   total s   peak MB\n";
  for (const auto& [step, cost] : costs) {
    const Figures f = figures(cost.seconds);
    char line[160];
    std::snprintf(line, sizeof line, "%-26s %7zu %9.3f %9.3f %9.3f %9.1f %9.0f\n", step.c_str(), cost.seconds.size(),
                  f.mean, f.median, f.p95, f.total, megabytes(cost.peak_bytes));
    text += line;
  }
  return text;
}

Json to_json(const std::map<std::string, StepCost>& costs) {
  Json json = Json::object();
  for (const auto& [step, cost] : costs) {
    const Figures f = figures(cost.seconds);
    json[step] = {{"assets", cost.seconds.size()},
                  {"mean_s", f.mean},
                  {"median_s", f.median},
                  {"p95_s", f.p95},
                  {"total_s", f.total},
                  {"peak_mb", megabytes(cost.peak_bytes)}};
  }
  return json;
}

}  // namespace anigen::prepare
