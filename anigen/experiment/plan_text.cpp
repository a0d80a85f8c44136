#include "anigen/eval/tables.h"
#include "anigen/experiment/estimate.h"
#include "anigen/experiment/experiment_command.h"
#include "anigen/experiment/job_record.h"

namespace anigen::experiment {
namespace {

std::string state_of(const std::filesystem::path& out, const Job& job) {
  const auto record = read_record(out, job.id);
  if (!record) return "to do";
  if (record->state == JobRecord::State::kDone) return is_done(out, job) ? "done" : "to do (its folder is gone)";
  return word_of(record->state);
}

std::string whom(const Job& job) {
  if (job.serves.size() > 2) return std::to_string(job.serves.size()) + " runs";
  std::string text;
  for (const std::string& run : job.serves) text += (text.empty() ? "" : " | ") + run;
  return text;
}

}  // namespace

std::string plan_text(const std::filesystem::path& out, const Plan& plan) {
  const Estimates estimates(out);
  eval::Table table{{"job", "for", "state", "took", "expected", "memory", "disk"}, {}};
  double seconds = 0, bytes = 0;
  std::size_t to_do = 0, unknown = 0;
  for (const Job& job : plan.jobs) {
    const auto record = read_record(out, job.id);
    const bool done = is_done(out, job);
    table.rows.push_back({job.id, whom(job), state_of(out, job), record ? duration_text(record->seconds) : "",
                          done ? "" : duration_text(estimates.seconds(job)),
                          record ? size_text(static_cast<double>(record->peak_bytes)) : "",
                          done ? size_text(static_cast<double>(record->disk_bytes)) : size_text(estimates.bytes(job))});
    if (done) continue;
    ++to_do;
    seconds += estimates.seconds(job);
    bytes += estimates.bytes(job);
    unknown += estimates.seconds(job) > 0 ? 0 : 1;
  }
  std::string text = to_markdown(table) + "\n" + std::to_string(plan.jobs.size() - to_do) + " of " +
                     std::to_string(plan.jobs.size()) + " jobs done";
  if (to_do > 0) {
    text += "; the rest takes " + duration_text(seconds) + " and " + size_text(bytes);
    if (unknown > 0) text += ", not counting " + std::to_string(unknown) + " jobs whose time nobody knows yet";
  }
  return text + "\n";
}

Json plan_json(const std::filesystem::path& out, const Plan& plan) {
  const Estimates estimates(out);
  Json jobs = Json::array();
  for (const Job& job : plan.jobs) {
    const auto record = read_record(out, job.id);
    Json needs = Json::array();
    for (const std::size_t need : job.needs) needs.push_back(plan.jobs[need].id);
    jobs.push_back({{"id", job.id},
                    {"step", job.step},
                    {"key", job.key},
                    {"state", state_of(out, job)},
                    {"serves", job.serves},
                    {"needs", needs},
                    {"folder", job.folder.string()},
                    {"command", shell_line(job.command)},
                    {"expected_seconds", estimates.seconds(job)},
                    {"expected_bytes", estimates.bytes(job)},
                    {"seconds", record ? record->seconds : 0.0},
                    {"peak_bytes", record ? record->peak_bytes : 0}});
  }
  return {{"jobs", jobs}};
}

}  // namespace anigen::experiment
