#pragma once
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <tuple>
#include <vector>

#include "anigen/core/config_fields.h"
#include "anigen/experiment/plan.h"

namespace anigen::experiment {

/// Fingerprint of a file, or of all files under a folder: relative path, size and time of change. Cheap enough for
/// folders of many gigabytes; copying a file without its time counts as a change.
/// @throws InputError when there is nothing at that path
std::string input_fingerprint(const std::filesystem::path& path);

/// SHA-256 of a program file and of the modules that it may load, anigen-torch.so (apps/common/torch_half.h) and
/// anigen-opencv.so (io/opencv_module.h) in ../lib/anigen, where they are; but for the commit that they were built of
/// (core/version.h) and the linker's own digest of them: a commit that leaves the code as it was leaves this as it was.
/// Read again only when a file's size or time has changed. @throws InputError when the program is not there
std::string program_fingerprint(const std::filesystem::path& program);

/// Cores that a job had, beside others that wanted theirs: times of unlike shares cannot be compared.
struct CoreShare {
  static constexpr int kUnknown = 0, kChanged = -1;  ///< of a record from before; of attempts with several shares
  int threads = kUnknown, at_once = kUnknown;        ///< of the job; jobs that run at the same time, at most

  std::string text() const;  ///< "2 threads, jobs at once: 1"
  bool operator==(const CoreShare& other) const { return threads == other.threads && at_once == other.at_once; }
  bool operator<(const CoreShare& other) const {
    return std::tie(threads, at_once) < std::tie(other.threads, other.at_once);
  }
};

/// Record of a job that was begun: records/<id>.json, beside its log records/<id>.log.
struct JobRecord : JsonOptions<JobRecord> {
  enum class State { kBegun, kDone, kFailed, kInterrupted };
  State state = State::kBegun;
  std::string step, key, content;
  std::string command;            ///< as it was last called
  std::string started, finished;  ///< UTC, ISO 8601; of the last attempt
  double seconds = 0;             ///< of all attempts together
  double expected_seconds = 0;    ///< what the author expected; 0: unknown
  std::uint64_t peak_bytes = 0;   ///< most memory of a process of the job
  std::uint64_t disk_bytes = 0;   ///< of its folder, once done
  CoreShare share;                ///< of all attempts
  int attempts = 0, status = 0;   ///< exit status of the last one; -N: ended by signal N

  void fields(ConfigFields& f);
};

const char* word_of(JobRecord::State state);

std::filesystem::path record_file(const std::filesystem::path& out, const std::string& id);
std::filesystem::path log_file(const std::filesystem::path& out, const std::string& id);
/// Folder of the logs of processes that shared a job.
std::filesystem::path worker_logs(const std::filesystem::path& out, const std::string& id);

/// Lock that a run of all jobs, and a run of one job, holds meanwhile.
std::filesystem::path run_lock_file(const std::filesystem::path& out);
std::filesystem::path job_lock_file(const std::filesystem::path& out, const std::string& id);

/// Ids of the jobs that have a record, sorted.
std::vector<std::string> recorded_jobs(const std::filesystem::path& out);

/// @return nothing when the job was never begun @throws InputError for a damaged record
std::optional<JobRecord> read_record(const std::filesystem::path& out, const std::string& id);
void write_record(const std::filesystem::path& out, const std::string& id, const JobRecord& record);

/// A job's program and arguments as they are run, but for threads. What lies in a job's folder was made by equal code,
/// whatever its commit, since the code is part of the job's name: programs that ask about that are told so.
std::vector<std::string> words_to_run(const Job& job);

/// The last line of a log that says something, at most so many characters; progress bars count as lines. Empty without
/// such a file.
std::string last_line(const std::filesystem::path& log, std::size_t most);

/// Done, with its results still there.
bool is_done(const std::filesystem::path& out, const Job& job);

/// Lets jobs whose results were made by other code, but by the same command on the same folders, stand for those of the
/// plan: their folder and record take the place of the planned ones, and `of_other_code` is set. For those who changed
/// a comment and trained for a week. Says which.
void accept_other_code(const std::filesystem::path& out, Plan& plan);

/// Now, in UTC, as 2026-01-31T23:59:59Z.
std::string utc_now();

struct RunOptions {
  std::size_t at_once = 1;   ///< jobs; cores are divided among them
  int threads = 0;           ///< to divide; 0: all cores
  std::string only = {};     ///< id or step of jobs to run; empty: all. What they need must be done.
  double report_every = 60;  ///< seconds between two lines about jobs that run
  /// Other processes may run the same jobs at the same time, and the programs share the work (core/lease.h). Then any
  /// one that ends well says that the job is done.
  bool together = false;
};

struct RunOutcome {
  std::size_t done = 0, kept = 0, failed = 0, skipped = 0;  ///< skipped: needed what failed
  std::size_t refused = 0;                                  ///< of those that failed, by status 2: wrong input
};

/// Runs what is not done, and says what is going on. A job that was interrupted, or failed before, is called again as
/// it was: every program goes on where it stopped. A failure stops only what needs it.
/// @throws Interrupted after Ctrl-C, when running jobs have saved and stopped; InputError when another process runs
/// jobs in the same folder, or `only` names nothing
RunOutcome run_jobs(const std::filesystem::path& out, const Plan& plan, const RunOptions& options);

/// Folders, records and logs in an experiment's folder that its plan no longer names: results of settings and code that
/// have changed since.
struct Leftover {
  std::string id;
  std::uint64_t bytes = 0;
};

std::vector<Leftover> find_leftovers(const std::filesystem::path& out, const Plan& plan);

/// Removes them, and nothing else. @throws Error naming what could not be removed
void remove_leftovers(const std::filesystem::path& out, const std::vector<Leftover>& leftovers);

}  // namespace anigen::experiment
