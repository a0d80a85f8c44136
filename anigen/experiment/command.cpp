#include "anigen/experiment/command.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <optional>
#include <set>
#include <system_error>
#include <thread>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/log.h"
#include "anigen/core/private_folder.h"
#include "anigen/core/process.h"
#include "anigen/core/table.h"
#include "anigen/core/text.h"
#include "anigen/experiment/report.h"
#include "anigen/experiment/run_jobs.h"

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

std::string state_of(const fs::path& out, const Job& job) {
  const auto record = read_record(out, job.id);
  if (!record) return "to do";
  if (record->state == JobRecord::State::kDone) return is_done(out, job) ? "done" : "to do (its folder is gone)";
  return word_of(record->state);
}

std::string whom(const Job& job) {
  if (job.serves.size() > 2) return std::to_string(job.serves.size()) + " runs";
  return joined(job.serves, " | ");
}

/// The plan with states, expected time and disk, as a table and one closing line.
std::string plan_text(const fs::path& out, const Plan& plan) {
  const Estimates estimates(out);
  Table table{{"job", "for", "state", "took", "expected", "memory", "disk"}, {}};
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

Json plan_json(const fs::path& out, const Plan& plan) {
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

/// The jobs of one step, and the steps that must come first.
struct StepArray {
  std::string step;
  std::vector<std::string> jobs;
  std::set<std::string> after;
  Resources resources;  ///< the most that any of the jobs asks for, since variants may change them
};

Resources larger(Resources a, const Resources& b) {
  a.workers = std::max(a.workers, b.workers);
  a.cpus = std::max(a.cpus, b.cpus);
  a.gpus = std::max(a.gpus, b.gpus);
  a.memory_gb = std::max(a.memory_gb, b.memory_gb);
  a.hours = std::max(a.hours, b.hours);
  if (a.partition.empty()) a.partition = b.partition;
  return a;
}

std::vector<StepArray> arrays_of(const fs::path& out, const Plan& plan) {
  std::vector<StepArray> arrays;
  for (const Job& job : plan.jobs) {
    if (is_done(out, job)) continue;
    auto array = std::find_if(arrays.begin(), arrays.end(), [&](const StepArray& a) { return a.step == job.step; });
    if (array == arrays.end()) array = arrays.insert(arrays.end(), {job.step, {}, {}, job.resources});
    array->jobs.push_back(job.id);
    array->resources = larger(array->resources, job.resources);
    for (const std::size_t need : job.needs)
      if (!is_done(out, plan.jobs[need])) array->after.insert(plan.jobs[need].step);
  }
  // A variant's later jobs may need a step whose array began further down the list.
  std::vector<StepArray> ordered;
  std::set<std::string> placed;
  while (ordered.size() < arrays.size()) {
    const std::size_t before = ordered.size();
    for (const StepArray& array : arrays) {
      const bool ready = std::all_of(array.after.begin(), array.after.end(),
                                     [&](const std::string& step) { return placed.count(step) > 0; });
      if (!ready || !placed.insert(array.step).second) continue;
      ordered.push_back(array);
    }
    if (ordered.size() == before)
      throw NotSupportedError("", "--emit slurm", "steps that come before each other in different variants");
  }
  return ordered;
}

/// Starts the program, passes on that time is up, and decides whether the task comes back.
constexpr char kRunAndComeBack[] = R"sh(status=0
child=
trap '[ -z "$child" ] || kill -TERM "$child" 2> /dev/null || true' TERM
"${call[@]}" &
child=$!
wait "$child" || status=$?
# A signal ends the waiting, not the program.
while kill -0 "$child" 2> /dev/null; do status=0; wait "$child" || status=$?; done
come_back() { if [ "${SLURM_RESTART_COUNT:-0}" -lt "$1" ]; then scontrol requeue "$SLURM_JOB_ID" || true; fi; }
case $status in
  0 | 2) ;;                 # done; wrong input, which stays wrong
  130) come_back 100 ;;     # saved because time was up
  *) come_back 2 ;;         # failed: a second and a third try
esac
exit $status
)sh";

std::string script(const StepArray& array, const std::string& name, const std::vector<std::string>& command,
                   const fs::path& working_folder) {
  const auto workers = static_cast<std::size_t>(array.resources.workers);
  std::string text = "#!/usr/bin/env bash\n#SBATCH --job-name=" + array.step + "\n#SBATCH --array=0-" +
                     std::to_string(array.jobs.size() * workers - 1) + "\n#SBATCH --output=" + name + "_%a.out\n" +
                     sbatch_lines(array.resources) +
                     "#SBATCH --requeue\n#SBATCH --open-mode=append\n#SBATCH --signal=B:TERM@120\n"
                     "set -euo pipefail\njobs=(";
  for (const std::string& job : array.jobs) text += "\n  " + job;
  text += "\n)\n";
  std::string call = shell_line(command);
  if (workers > 1) {
    text += "workers=" + std::to_string(workers) + "  # tasks that share a job\n" +
            "job=${jobs[$((SLURM_ARRAY_TASK_ID / workers))]}\n";
    call += " \"$job\" --together";
  } else {
    text += "job=${jobs[$SLURM_ARRAY_TASK_ID]}\n";
    call += " \"$job\"";
  }
  return text + "cd " + shell_line({working_folder.string()}) + "\ncall=(" + call + ")\n" + kRunAndComeBack;
}

fs::path own_program() { return fs::read_symlink("/proc/self/exe"); }

/// Asks every program whether it takes the options of its jobs. Without that a wrong word of the last step shows when
/// all others are done. @throws InputError naming the step
void check_commands(const Experiment& experiment, const fs::path& out, const Plan& plan) {
  std::set<std::size_t> to_do;
  for (const PlannedRun& run : plan.runs) {
    if (run.seed != experiment.seeds.front()) continue;  // the options of others differ in that number alone
    for (const auto& [step, index] : run.jobs)
      if (!is_done(out, plan.jobs[index])) to_do.insert(index);
  }
  const PrivateFolder said;
  Progress progress("checking options", to_do.size(), "jobs");
  for (const std::size_t index : to_do) {
    progress.advance();
    const Job& job = plan.jobs[index];
    ChildProgram program;
    program.words = words_to_run(job);
    program.words.emplace_back("--check-options");
    program.log = said / job.id;
    ChildProcess child(program);
    std::optional<ChildProcess::End> end;
    for (constexpr std::chrono::milliseconds kPause{2}; !(end = child.poll()); std::this_thread::sleep_for(kPause))
      throw_if_interrupted();
    if (end->status == 0) continue;
    const std::string line = last_line(program.log, 300);
    throw InputError(experiment.file.string(), "/steps/" + job.step,
                     (job.serves.front().empty() ? "" : "for " + job.serves.front() + ": ") + job.program + " says " +
                         (line.empty() ? "nothing and ends with status " + std::to_string(end->status) : line) +
                         "\n  " + shell_line(job.command));
  }
}

std::string counted(std::size_t n, const std::string& what) { return std::to_string(n) + " " + what; }

std::string run(const ExperimentCommand& command, const Experiment& experiment, const Plan& plan, bool json) {
  RunOptions options{command.jobs, command.threads, command.only};
  options.together = command.together;
  const RunOutcome outcome = run_jobs(command.place.out, plan, options);
  // A report that cannot be written must hide neither that jobs failed nor, on a cluster, that one job is done.
  std::string text, problem;
  try {
    text = results_markdown(collect_all_results(experiment, plan, command.place),
                            judge_claims(experiment, plan, command.place.out));
    text += "\nreport: " + write_report(experiment, plan, command.place).string() + "\n";
  } catch (const Error& error) {
    problem = error.what();
    log::warn("no report: {}", problem);
  }
  if (outcome.failed > 0) {
    const std::string failure = counted(outcome.failed, "jobs failed, ") +
                                counted(outcome.skipped, "were not begun for it; ") +
                                (command.place.out / "records").string() + " holds their logs; ";
    // A task of a cluster is not queued again for an input that stays wrong.
    if (!command.only.empty() && outcome.refused == outcome.failed)
      throw InputError(experiment.file.string(), command.only, failure + "their input is wrong");
    throw Error(failure + "the same command tries again");
  }
  if (!problem.empty() && command.only.empty()) throw Error("all jobs are done, but there is no report: " + problem);
  if (json) return plan_json(command.place.out, plan).dump(2) + "\n";
  return text + counted(outcome.done, "jobs done, ") + counted(outcome.kept, "kept\n");
}

std::string emit_slurm(const ExperimentCommand& command, const Plan& plan) {
  std::vector<std::string> call{own_program().string(), "run", fs::absolute(command.file).string(), "--output",
                                command.place.out.string()};
  for (const std::string& override_text : command.overrides) call.insert(call.end(), {"--set", override_text});
  if (!command.scale.empty()) call.insert(call.end(), {"--scale", command.scale});
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

std::vector<fs::path> write_slurm(const fs::path& out, const Plan& plan, const std::vector<std::string>& command,
                                  const fs::path& working_folder) {
  const fs::path folder = out / "slurm";
  std::vector<fs::path> files;
  std::string submit =
      "#!/usr/bin/env bash\n# Submits the experiment. Arguments go to every sbatch: submit.sh --partition gpu --gpus "
      "1\n"
      "set -euo pipefail\ncd \"$(dirname \"$0\")\"\n";
  std::size_t number = 0;
  for (const StepArray& array : arrays_of(out, plan)) {
    char prefix[8];
    std::snprintf(prefix, sizeof prefix, "%02zu_", ++number);
    const fs::path file = folder / (prefix + array.step + ".sbatch");
    const std::string text = script(array, prefix + array.step, command, working_folder);
    write_file_atomically(file, text);
    files.push_back(file);
    std::string after;
    for (const std::string& step : array.after) after += ":$job_" + step;
    submit += "job_" + array.step + "=$(sbatch --parsable" + (after.empty() ? "" : " --dependency=afterok" + after) +
              " \"$@\" " + file.filename().string() + ")\necho \"" + array.step + ": $job_" + array.step + "\"\n";
  }
  write_file_atomically(folder / "submit.sh", submit);
  fs::permissions(folder / "submit.sh", fs::perms::owner_exec, fs::perm_options::add);
  files.push_back(folder / "submit.sh");
  return files;
}

namespace {

double seconds_of(const Plan& plan, const fs::path& out) {
  double seconds = 0;
  for (const Job& job : plan.jobs) {
    if (const auto record = read_record(out, job.id)) seconds += record->seconds;
  }
  return seconds;
}

/// Claims of one experiment as far as they can be read, whatever its jobs came to.
void collect_claims(const ExperimentCommand& command, CollectedClaims& collected) {
  const Experiment experiment = read_experiment(command.file, command.overrides, command.scale);
  collected.title = experiment.title;
  Plan plan = make_plan(experiment, command.place);
  if (command.accept_other_code) accept_other_code(command.place.out, plan);
  collected.seconds = seconds_of(plan, command.place.out);
  collected.claims = judge_claims(experiment, plan, command.place.out);
}

/// An experiment of which a program refuses an option fails in its turn, which may be days away.
void warn_of_refused_commands(const ExperimentCommand& command, const Collection& collection) {
  for (const fs::path& file : collection.files) {
    try {
      const Experiment experiment = read_experiment(file, command.overrides, command.scale);
      check_commands(experiment, command.place.out, make_plan(experiment, command.place));
    } catch (const InputError& error) {
      log::warn("{} will fail: {}", file.stem().string(), error.what());
    }
  }
}

std::string run_collection(const ExperimentCommand& command, const Collection& collection, bool json) {
  if (command.slurm || !command.only.empty())
    throw InputError(command.file.string(), command.slurm ? "--emit" : "--only",
                     "is for one experiment, and this is a collection of them");
  using What = ExperimentCommand::What;
  if (command.what == What::kClean)
    throw NotSupportedError(command.file.string(), "", "cleaning a collection, whose experiments share their jobs");
  std::string text;
  std::vector<CollectedClaims> all;
  std::size_t failed = 0;
  Json list = Json::array();
  if (command.what == What::kRun && !command.dry_run) warn_of_refused_commands(command, collection);
  for (const fs::path& file : collection.files) {
    ExperimentCommand one = command;
    one.file = file;
    one.place.report = command.place.out / file.stem();
    CollectedClaims& collected = all.emplace_back();
    collected.title = file.stem().string();
    try {
      const std::string said = run_experiment_command(one, json);
      if (json && command.what != What::kReport)
        list.push_back({{"experiment", file.stem().string()}, {"plan", Json::parse(said)}});
      else
        text += "# " + file.stem().string() + "\n" + said + "\n";
    } catch (const Interrupted&) {
      throw;
    } catch (const Error& error) {
      ++failed;
      collected.failure = error.what();
      log::warn("{}: {}", file.stem().string(), error.what());
    }
    try {
      collect_claims(one, collected);
    } catch (const InputError& error) {
      if (collected.failure.empty()) collected.failure = error.what();
    }
  }
  const bool has_results = command.what == What::kReport || (command.what == What::kRun && !command.dry_run);
  if (has_results) text = write_verdicts(collection, all, command.scale, command.place.out);
  if (failed > 0)
    throw Error(counted(failed, "of ") + counted(all.size(), "experiments failed; the same command tries again") +
                (has_results ? "; verdicts so far: " + (command.place.out / "verdicts.md").string() : ""));
  return json && !list.empty() ? list.dump(2) + "\n" : text;
}

}  // namespace

std::string run_experiment_command(ExperimentCommand command, bool json) {
  Workplace& place = command.place;
  if (place.out.empty()) {
    const std::string name = command.file.stem().string();
    place.out = fs::path("runs") / (command.scale.empty() ? name : name + "_" + command.scale);
  }
  if (place.programs.empty()) place.programs = own_program().parent_path();
  place.out = fs::absolute(place.out).lexically_normal();
  place.programs = fs::absolute(place.programs).lexically_normal();
  if (const auto collection = read_collection(command.file)) return run_collection(command, *collection, json);
  const Experiment experiment = read_experiment(command.file, command.overrides, command.scale);
  Plan plan = make_plan(experiment, place);
  if (command.accept_other_code) accept_other_code(place.out, plan);
  if (command.what == ExperimentCommand::What::kRun && command.only.empty())
    check_commands(experiment, place.out, plan);
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
