#include "anigen/experiment/method_costs.h"

#include <algorithm>
#include <optional>
#include <set>

#include "anigen/core/error.h"
#include "anigen/core/log.h"
#include "anigen/core/run_folder.h"
#include "anigen/experiment/command.h"
#include "anigen/experiment/run_jobs.h"
#include "anigen/experiment/sheets.h"

namespace anigen::experiment {

namespace {

/// Jobs of a step in the first variant, one per seed that changes it.
std::vector<const Job*> jobs_of_step(const Plan& plan, const std::string& step) {
  std::vector<const Job*> jobs;
  std::set<std::size_t> seen;
  for (const PlannedRun& run : plan.runs) {
    const auto found = run.jobs.find(step);
    if (run.variant != 0 || found == run.jobs.end() || !seen.insert(found->second).second) continue;
    jobs.push_back(&plan.jobs[found->second]);
  }
  return jobs;
}

std::optional<JobRecord> record_when_done(const std::filesystem::path& out, const Job& job) {
  std::optional<JobRecord> record = read_record(out, job.id);
  if (record && record->state != JobRecord::State::kDone) record.reset();
  return record;
}

/// Mean seconds of a step's jobs that are done. @param peak becomes their largest memory, where that is more
/// @param ran gets their shares of the cores
double mean_seconds(const Plan& plan, const std::filesystem::path& out, const std::string& step, std::uint64_t* peak,
                    std::set<CoreShare>& ran) {
  double sum = 0.0;
  int count = 0;
  for (const Job* job : jobs_of_step(plan, step)) {
    const auto record = record_when_done(out, *job);
    if (!record) continue;
    sum += record->seconds;
    ran.insert(record->share);
    ++count;
    if (peak != nullptr) *peak = std::max(*peak, static_cast<std::uint64_t>(record->peak_bytes));
  }
  return count > 0 ? sum / count : 0.0;
}

/// Parameters of a run's models, as its training wrote them down. @param part name of one model; empty: all
/// @return below 0 where nothing is written down
std::int64_t parameters_of_run(const std::filesystem::path& run, const std::string& part) {
  const std::filesystem::path file = RunFolder{run}.parameters();
  std::error_code error;
  if (!std::filesystem::is_regular_file(file, error)) return -1;
  const Json counts = read_json(file);
  if (!counts.is_object()) throw InputError(file.string(), "", "expected numbers by name of model");
  std::int64_t sum = 0;
  bool found = false;
  for (const auto& [name, count] : counts.items()) {
    if (!count.is_number_integer()) throw InputError(file.string(), "/" + name, "expected a number");
    if (!part.empty() && name != part) continue;
    sum += count.get<std::int64_t>();
    found = true;
  }
  if (!found) throw InputError(file.string(), "", "knows no model \"" + part + "\"");
  return sum;
}

/// Seconds of all jobs of some trainings together, per seed. A step that no seed changes counts for each. Empty when
/// one is not done, or steps have other numbers of jobs.
std::vector<double> training_by_seed(const Plan& plan, const std::filesystem::path& out,
                                     const std::set<std::string>& steps) {
  std::vector<double> sums = {0.0};
  for (const std::string& step : steps) {
    const std::vector<const Job*> jobs = jobs_of_step(plan, step);
    if (sums.size() == 1) sums.resize(std::max<std::size_t>(1, jobs.size()), sums.front());
    if (jobs.empty() || (jobs.size() > 1 && jobs.size() != sums.size())) return {};
    for (std::size_t seed = 0; seed < sums.size(); ++seed) {
      const auto record = record_when_done(out, *jobs[jobs.size() > 1 ? seed : 0]);
      if (!record) return {};
      sums[seed] += record->seconds;
    }
  }
  return sums;
}

MethodCost cost_of_row(const Plan& plan, const std::filesystem::path& out, const CostRow& row) {
  MethodCost cost;
  cost.label = row.label;
  double all_assets = 0;
  for (const Job* job : jobs_of_step(plan, row.step)) {
    ++cost.wanted;
    const auto record = record_when_done(out, *job);
    if (!record) continue;
    const std::size_t assets = matching_files(job->folder, row.files).size();
    if (assets == 0) {
      log::warn("{}: no file {}: it has no cost per asset", job->folder.string(), row.files);
      continue;
    }
    ++cost.jobs;
    cost.assets = assets;
    all_assets += static_cast<double>(assets);
    cost.by_job.push_back(record->seconds / static_cast<double>(assets));
    cost.seconds += cost.by_job.back();
    cost.peak_bytes = std::max(cost.peak_bytes, static_cast<std::uint64_t>(record->peak_bytes));
    cost.ran.insert(record->share);
  }
  if (cost.jobs == 0) return cost;
  cost.seconds /= static_cast<double>(cost.jobs);
  for (const std::string& step : row.before)
    cost.seconds_before +=
        mean_seconds(plan, out, step, &cost.peak_bytes, cost.ran) * static_cast<double>(cost.jobs) / all_assets;
  for (double& seconds : cost.by_job) seconds += cost.seconds_before;
  std::set<std::string> trained;
  for (const std::string& model : row.models) {
    const std::size_t slash = model.find('/');
    const std::string step = model.substr(0, slash);
    if (trained.insert(step).second) cost.training_seconds += mean_seconds(plan, out, step, nullptr, cost.training_ran);
    const std::vector<const Job*> jobs = jobs_of_step(plan, step);
    const std::string part = slash == std::string::npos ? "" : model.substr(slash + 1);
    const std::int64_t count = jobs.empty() ? -1 : parameters_of_run(jobs.front()->folder, part);
    cost.parameters = count < 0 || cost.parameters < 0 ? -1 : cost.parameters + count;
  }
  cost.training_by_seed = training_by_seed(plan, out, trained);
  return cost;
}

}  // namespace

std::vector<MethodCost> method_costs(const Plan& plan, const std::filesystem::path& out, const CostSpec& spec) {
  std::vector<MethodCost> costs;
  for (const CostRow& row : spec.rows) costs.push_back(cost_of_row(plan, out, row));
  return costs;
}

Table method_cost_table(const std::vector<MethodCost>& costs) {
  Table table{
      {"method", "assets", "seconds per asset", "with what comes before", "peak memory", "parameters", "training"}, {}};
  for (const MethodCost& cost : costs) {
    if (cost.jobs == 0) {
      table.rows.push_back({cost.label, "–", "–", "–", "–", "–", "–"});
      continue;
    }
    const std::string parameters = cost.parameters < 0 ? "?"
                                   : cost.parameters == 0
                                       ? "none"
                                       : fixed(1e-6 * static_cast<double>(cost.parameters), 2) + " M";
    table.rows.push_back({cost.label, std::to_string(cost.assets), fixed(cost.seconds, 2),
                          fixed(cost.seconds + cost.seconds_before, 2), size_text(static_cast<double>(cost.peak_bytes)),
                          parameters, cost.training_seconds > 0 ? duration_text(cost.training_seconds) : "none"});
  }
  return table;
}

Json to_json(const std::vector<MethodCost>& costs) {
  Json rows = Json::array();
  for (const MethodCost& cost : costs) {
    rows.push_back({{"method", cost.label},
                    {"jobs", cost.jobs},
                    {"assets", cost.assets},
                    {"seconds", cost.seconds},
                    {"seconds_before", cost.seconds_before},
                    {"peak_bytes", cost.peak_bytes},
                    {"parameters", cost.parameters < 0 ? Json(nullptr) : Json(cost.parameters)},
                    {"training_seconds", cost.training_seconds}});
  }
  return rows;
}

}  // namespace anigen::experiment
