#include "anigen/experiment/run_jobs.h"

#include <algorithm>
#include <chrono>
#include <list>
#include <optional>
#include <system_error>
#include <thread>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/file_lock.h"
#include "anigen/core/interrupt.h"
#include "anigen/core/log.h"
#include "anigen/core/parallel.h"
#include "anigen/core/process_identity.h"
#include "anigen/experiment/estimate.h"
#include "anigen/experiment/folder_size.h"
#include "anigen/experiment/input_fingerprint.h"
#include "anigen/experiment/job_record.h"
#include "anigen/experiment/logged_process.h"

namespace anigen::experiment {
namespace {

namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;

constexpr auto kPollEvery = std::chrono::milliseconds(100);

double seconds_since(Clock::time_point start) { return std::chrono::duration<double>(Clock::now() - start).count(); }

/// Jobs of the plan on their way from waiting to done.
class JobRunner {
 public:
  JobRunner(const fs::path& out, const Plan& plan, const RunOptions& options)
      : out_(out), plan_(plan), options_(options), states_(plan.jobs.size(), State::kWaiting) {
    choose();
  }

  RunOutcome run() {
    auto told = Clock::now();
    while (true) {
      if (interrupt_requested()) stop();
      collect();
      start_ready();
      if (running_.empty()) break;
      if (seconds_since(told) >= options_.report_every) {
        for (const Running& job : running_) tell(job);
        told = Clock::now();
      }
      std::this_thread::sleep_for(kPollEvery);
    }
    for (const State state : states_) outcome_.skipped += state == State::kWaiting ? 1 : 0;
    return outcome_;
  }

 private:
  enum class State { kWaiting, kRunning, kDone, kFailed, kNotAsked };
  struct Running {
    std::size_t job;
    FileLock lock;
    LoggedProcess process;
    fs::path log;
    JobRecord record;
    Clock::time_point started;
  };

  void choose() {
    bool any = false;
    for (std::size_t j = 0; j < plan_.jobs.size(); ++j) {
      const Job& job = plan_.jobs[j];
      const bool asked = options_.only.empty() || options_.only == job.id || options_.only == job.step;
      any = any || asked;
      if (is_done(out_, job) && !lost_its_folder(job)) {
        states_[j] = State::kDone;
        outcome_.kept += asked ? 1 : 0;
      } else if (!asked) {
        states_[j] = State::kNotAsked;
      }
      to_run_ += states_[j] == State::kWaiting ? 1 : 0;
    }
    if (!any) throw InputError("", "--only", "no job or step of this experiment is called '" + options_.only + "'");
    if (options_.only.empty()) return;
    for (std::size_t j = 0; j < plan_.jobs.size(); ++j) {
      if (states_[j] != State::kWaiting) continue;
      for (const std::size_t need : plan_.jobs[j].needs) {
        if (states_[need] == State::kNotAsked)
          throw InputError("", "--only", plan_.jobs[j].id + " needs " + plan_.jobs[need].id + ", which is not done");
      }
    }
  }

  /// What was written into another job's folder is gone when that job has to be run again.
  bool lost_its_folder(const Job& job) const {
    return job.writes_into_other && std::any_of(job.needs.begin(), job.needs.end(), [&](std::size_t need) {
             return plan_.jobs[need].folder == job.folder && states_[need] != State::kDone;
           });
  }

  void forget_what_was_written_into(const Job& owner) {
    if (owner.writes_into_other) return;
    for (const Job& job : plan_.jobs) {
      std::error_code error;
      if (job.writes_into_other && job.folder == owner.folder) fs::remove(record_file(out_, job.id), error);
    }
  }

  bool ready(const Job& job) const {
    return std::all_of(job.needs.begin(), job.needs.end(),
                       [&](std::size_t need) { return states_[need] == State::kDone; });
  }

  void start_ready() {
    for (std::size_t j = 0; j < states_.size() && running_.size() < options_.at_once; ++j) {
      if (states_[j] == State::kWaiting && ready(plan_.jobs[j])) start(j);
    }
  }

  void start(std::size_t j) {
    const Job& job = plan_.jobs[j];
    auto lock = FileLock::try_lock(job_lock_file(out_, job.id),
                                   options_.together ? FileLock::Kind::kShared : FileLock::Kind::kExclusive);
    if (!lock) throw InputError(out_.string(), "", "another anigen-experiment is running " + job.id);
    if (input_fingerprint(job.command.front()) != job.program_state) {
      throw InputError(job.command.front(), "",
                       "has changed since this run began; the same command makes a new plan and goes on");
    }
    JobRecord record = read_record(out_, job.id).value_or(JobRecord{});
    if (record.state == JobRecord::State::kDone) record = {};  // its results are gone: nothing of it is continued
    forget_what_was_written_into(job);
    record.state = JobRecord::State::kBegun;
    record.step = job.step;
    record.key = job.key;
    record.content = job.content;
    record.expected_seconds = job.minutes * 60;
    record.command = shell_line(job.command);
    record.started = utc_now();
    record.finished.clear();
    ++record.attempts;
    write_record(out_, job.id, record);
    states_[j] = State::kRunning;
    log::info("[{}/{}] {}{}", ++begun_, to_run_, job.id, of_whom(job));
    const fs::path log = log_of(job);
    running_.push_back({j, std::move(*lock), LoggedProcess(command_of(job), log), log, record, Clock::now()});
  }

  /// Several processes do not append to one file: on a shared file system lines would be lost.
  fs::path log_of(const Job& job) const {
    return options_.together ? worker_logs(out_, job.id) / (process_number() + ".log") : log_file(out_, job.id);
  }

  /// With the job's share of the cores, where there is something to share. What lies in a job's folder was made by
  /// equal code, whatever its commit: the code is part of the job's name.
  std::vector<std::string> command_of(const Job& job) const {
    std::vector<std::string> command = job.command;
    if (job.program == "anigen-generate") command.emplace_back("--accept-other-code");
    if (options_.threads == 0 && options_.at_once == 1) return command;
    const int cores = options_.threads > 0 ? options_.threads : thread_count();
    command.insert(command.end(),
                   {"--threads", std::to_string(std::max(1, cores / static_cast<int>(options_.at_once)))});
    return command;
  }

  static std::string of_whom(const Job& job) {
    const std::string& first = job.serves.front();
    if (first.empty()) return "";
    return " (" + first + (job.serves.size() > 1 ? " and " + std::to_string(job.serves.size() - 1) + " more" : "") +
           ")";
  }

  void tell(const Running& running) const {
    log::info("  {} {}: {}", plan_.jobs[running.job].id, duration_text(seconds_since(running.started)),
              last_line(running.log));
  }

  void collect() {
    for (auto running = running_.begin(); running != running_.end();) {
      const auto end = running->process.poll();
      if (!end) {
        ++running;
        continue;
      }
      finish(*running, *end, false);
      running = running_.erase(running);
    }
  }

  void finish(Running& running, const LoggedProcess::End& end, bool stopped) {
    const Job& job = plan_.jobs[running.job];
    JobRecord& record = running.record;
    record.seconds += seconds_since(running.started);
    record.peak_bytes = std::max(record.peak_bytes, end.peak_bytes);
    record.status = end.status;
    record.finished = utc_now();
    record.state = end.status == 0 ? JobRecord::State::kDone
                   : stopped       ? JobRecord::State::kInterrupted
                                   : JobRecord::State::kFailed;
    if (end.status == 0) record.disk_bytes = job.writes_into_other ? 0 : folder_size(job.folder);
    // What happened to this process says nothing about a job that another one has finished.
    const bool done_elsewhere = options_.together && end.status != 0 && is_done(out_, job);
    if (!done_elsewhere) write_record(out_, job.id, record);
    states_[running.job] = end.status == 0 ? State::kDone : State::kFailed;
    if (end.status == 0) {
      ++outcome_.done;
      log::info("  {} done in {}", job.id, duration_text(record.seconds));
    } else if (!stopped) {
      ++outcome_.failed;
      log::error("  {} failed with status {}: {} ({})", job.id, end.status, last_line(running.log, 300),
                 running.log.string());
    }
  }

  [[noreturn]] void stop() {
    log::info("stopping: {} running jobs save their state", running_.size());
    for (Running& running : running_) running.process.ask_to_stop();
    for (Running& running : running_) {
      auto end = running.process.poll();
      for (; !end; end = running.process.poll()) std::this_thread::sleep_for(kPollEvery);
      finish(running, *end, true);
    }
    running_.clear();
    throw Interrupted("interrupted; the same command goes on from here");
  }

  const fs::path& out_;
  const Plan& plan_;
  const RunOptions& options_;
  std::vector<State> states_;
  std::list<Running> running_;
  std::size_t to_run_ = 0, begun_ = 0;
  RunOutcome outcome_;
};

}  // namespace

RunOutcome run_jobs(const fs::path& out, const Plan& plan, const RunOptions& options) {
  // Array tasks of a cluster share the folder, each with a job of its own.
  std::optional<FileLock> lock;
  if (options.only.empty()) lock = FileLock::try_lock(run_lock_file(out), FileLock::Kind::kExclusive);
  if (options.together && options.only.empty())
    throw InputError("", "--together", "goes with --only: it is for the tasks of a cluster, each with one job");
  if (options.only.empty() && !lock)
    throw InputError(out.string(), "", "another anigen-experiment is running jobs here");
  return JobRunner(out, plan, options).run();
}

}  // namespace anigen::experiment
