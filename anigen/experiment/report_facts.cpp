#include "anigen/experiment/report_facts.h"

#include <algorithm>
#include <fstream>
#include <set>
#include <thread>

#include "anigen/core/version.h"
#include "anigen/experiment/estimate.h"
#include "anigen/experiment/input_fingerprint.h"
#include "anigen/experiment/job_record.h"

namespace anigen::experiment {
namespace {

std::string processor() {
  std::ifstream stream("/proc/cpuinfo");
  for (std::string line; std::getline(stream, line);) {
    const std::size_t colon = line.find(": ");
    if (line.rfind("model name", 0) == 0 && colon != std::string::npos) return line.substr(colon + 2);
  }
  return "unknown processor";
}

}  // namespace

eval::Table provenance_table(const Experiment& experiment, const Plan& plan, const Workplace& place) {
  std::string seeds;
  for (const std::uint64_t seed : experiment.seeds) seeds += (seeds.empty() ? "" : ", ") + std::to_string(seed);
  std::size_t done = 0;
  std::set<std::string> programs;
  for (const Job& job : plan.jobs) {
    done += is_done(place.out, job) ? 1 : 0;
    programs.insert(job.program);
  }
  eval::Table table{{"what", "is"}, {}};
  table.rows = {{"experiment", std::filesystem::absolute(experiment.file).lexically_normal().string()},
                {"written", utc_now()},
                {"jobs done", std::to_string(done) + " of " + std::to_string(plan.jobs.size())},
                {"seeds", seeds + (experiment.seeded.empty() ? " (no step takes them)" : "")},
                {"version", kVersion},
                {"machine", processor() + ", " + std::to_string(std::thread::hardware_concurrency()) + " threads"},
                {"device", place.device}};
  constexpr std::size_t kDigits = 16;
  for (const std::string& program : programs)
    table.rows.push_back({program, "SHA-256 " + program_fingerprint(place.programs / program).substr(0, kDigits)});
  return table;
}

eval::Table job_table(const Plan& plan, const std::filesystem::path& out) {
  eval::Table table{{"job", "for", "state", "time", "peak memory", "attempts"}, {}};
  for (const Job& job : plan.jobs) {
    const auto record = read_record(out, job.id);
    const std::string whom = job.serves.size() > 1 ? std::to_string(job.serves.size()) + " runs" : job.serves.front();
    if (!record) {
      table.rows.push_back({job.id, whom, "not begun", "", "", ""});
    } else {
      table.rows.push_back({job.id, whom, word_of(record->state), duration_text(record->seconds),
                            size_text(static_cast<double>(record->peak_bytes)), std::to_string(record->attempts)});
    }
  }
  return table;
}

std::string run_label(const Experiment& experiment, const PlannedRun& run) {
  std::string label = experiment.variants[run.variant].name;
  if (experiment.seeds.size() > 1) label += (label.empty() ? "" : ", ") + ("seed " + std::to_string(run.seed));
  return label;
}

std::string spread_text(const ResultTable& result) {
  std::size_t seeds = 0;
  for (const Row& row : result.rows)
    for (const Cell& cell : row.cells) seeds = std::max(seeds, cell.by_seed.size());
  if (seeds < 2) return "Mean over assets ± half of its 95 % interval (bootstrap over assets).";
  return "Mean over seeds ± half of its 95 % interval (Student's t over up to " + std::to_string(seeds) +
         " seeds; over assets by bootstrap where no seed changes anything).";
}

std::string difference_text() {
  return "Against the first variant, asset by asset, each asset's value being its mean over the seeds: mean, 95 % "
         "bootstrap interval over assets, p by exchanging signs at random (from 6 assets on).";
}

std::string missing_text(const ResultTable& result) {
  std::string text;
  for (const std::string& job : result.missing) text += (text.empty() ? "" : ", ") + job;
  return text.empty() ? "" : "Not run yet: " + text + ".";
}

}  // namespace anigen::experiment
