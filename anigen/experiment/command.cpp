#include "anigen/experiment/command.h"

#include <cmath>
#include <cstdio>
#include <system_error>

#include "anigen/core/error.h"
#include "anigen/core/log.h"
#include "anigen/core/process.h"
#include "anigen/experiment/report.h"
#include "anigen/experiment/run_jobs.h"
#include "anigen/experiment/slurm.h"

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

namespace {

namespace fs = std::filesystem;

fs::path own_program() { return fs::read_symlink("/proc/self/exe"); }

std::string counted(std::size_t n, const std::string& what) { return std::to_string(n) + " " + what; }

std::string run(const ExperimentCommand& command, const Experiment& experiment, const Plan& plan, bool json) {
  RunOptions options{command.jobs, command.threads, command.only};
  options.together = command.together;
  const RunOutcome outcome = run_jobs(command.place.out, plan, options);
  // A report that cannot be written must hide neither that jobs failed nor, on a cluster, that one job is done.
  std::string text, problem;
  try {
    text = results_markdown(collect_all_results(experiment, plan, command.place));
    text += "\nreport: " + write_report(experiment, plan, command.place).string() + "\n";
  } catch (const Error& error) {
    problem = error.what();
    log::warn("no report: {}", problem);
  }
  if (outcome.failed > 0) {
    throw Error(counted(outcome.failed, "jobs failed, ") + counted(outcome.skipped, "were not begun for it; ") +
                (command.place.out / "records").string() + " holds their logs; the same command tries again");
  }
  if (!problem.empty() && command.only.empty()) throw Error("all jobs are done, but there is no report: " + problem);
  if (json) return plan_json(command.place.out, plan).dump(2) + "\n";
  return text + counted(outcome.done, "jobs done, ") + counted(outcome.kept, "kept\n");
}

std::string emit_slurm(const ExperimentCommand& command, const Plan& plan) {
  std::vector<std::string> call{own_program().string(), "run", fs::absolute(command.file).string(), "--out",
                                command.place.out.string()};
  for (const std::string& override_text : command.overrides) call.insert(call.end(), {"--set", override_text});
  if (command.threads > 0) call.insert(call.end(), {"--threads", std::to_string(command.threads)});
  if (command.place.device != "cpu") call.insert(call.end(), {"--device", command.place.device});
  call.insert(call.end(), {"--programs", command.place.programs.string()});
  if (command.accept_other_code) call.emplace_back("--accept-other-code");
  call.emplace_back("--only");
  std::string text;
  for (const fs::path& file : write_slurm(command.place.out, plan, call, fs::current_path()))
    text += file.string() + "\n";
  return text;
}

std::string clean(const ExperimentCommand& command, const Plan& plan) {
  const std::vector<Leftover> leftovers = find_leftovers(command.place.out, plan);
  std::string text;
  double bytes = 0;
  for (const Leftover& leftover : leftovers) {
    bytes += static_cast<double>(leftover.bytes);
    text += leftover.id + "  " + size_text(static_cast<double>(leftover.bytes)) + "\n";
  }
  const auto lock = FileLock::try_lock(run_lock_file(command.place.out), FileLock::Kind::kExclusive);
  if (!lock) throw InputError(command.place.out.string(), "", "another anigen-experiment is running jobs here");
  if (!command.dry_run) remove_leftovers(command.place.out, leftovers);
  return text + counted(leftovers.size(), command.dry_run ? "jobs would be removed, " : "jobs removed, ") +
         size_text(bytes) + "\n";
}

}  // namespace

std::string run_experiment_command(ExperimentCommand command, bool json) {
  Workplace& place = command.place;
  if (place.out.empty()) place.out = fs::path("runs") / command.file.stem();
  if (place.programs.empty()) place.programs = own_program().parent_path();
  place.out = fs::absolute(place.out).lexically_normal();
  place.programs = fs::absolute(place.programs).lexically_normal();
  const Experiment experiment = read_experiment(command.file, command.overrides);
  Plan plan = make_plan(experiment, place);
  if (command.accept_other_code) accept_other_code(place.out, plan);
  switch (command.what) {
    case ExperimentCommand::What::kReport:
      return write_report(experiment, plan, place).string() + "\n";
    case ExperimentCommand::What::kClean:
      return clean(command, plan);
    case ExperimentCommand::What::kRun:
      if (command.slurm) return emit_slurm(command, plan);
      if (!command.dry_run) return run(command, experiment, plan, json);
      break;
    case ExperimentCommand::What::kStatus:
      break;
  }
  return json ? plan_json(place.out, plan).dump(2) + "\n" : plan_text(place.out, plan);
}

}  // namespace anigen::experiment
