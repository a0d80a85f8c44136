#pragma once
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "anigen/experiment/plan.h"

namespace anigen::experiment {

/// What is known of a job that was begun: records/<id>.json, beside its log records/<id>.log.
struct JobRecord {
  enum class State { kBegun, kDone, kFailed, kInterrupted };
  State state = State::kBegun;
  std::string step, key, content;
  std::string command;            ///< as it was last called
  std::string started, finished;  ///< UTC, ISO 8601; of the last attempt
  double seconds = 0;             ///< of all attempts together
  double expected_seconds = 0;    ///< what the author expected; 0: unknown
  std::uint64_t peak_bytes = 0;   ///< most memory of a process of the job
  std::uint64_t disk_bytes = 0;   ///< of its folder, once done
  int attempts = 0, status = 0;   ///< exit status of the last one; -N: ended by signal N
};

const char* word_of(JobRecord::State state);

std::filesystem::path record_file(const std::filesystem::path& out, const std::string& id);
std::filesystem::path log_file(const std::filesystem::path& out, const std::string& id);
/// Folder of the logs of processes that shared a job.
std::filesystem::path worker_logs(const std::filesystem::path& out, const std::string& id);

/// What a run of all jobs, and whoever runs one job, holds exclusively meanwhile.
std::filesystem::path run_lock_file(const std::filesystem::path& out);
std::filesystem::path job_lock_file(const std::filesystem::path& out, const std::string& id);

/// Ids of the jobs that have a record, sorted.
std::vector<std::string> recorded_jobs(const std::filesystem::path& out);

/// @return nothing when the job was never begun @throws InputError for a damaged record
std::optional<JobRecord> read_record(const std::filesystem::path& out, const std::string& id);
void write_record(const std::filesystem::path& out, const std::string& id, const JobRecord& record);

/// Done, with its results still there.
bool is_done(const std::filesystem::path& out, const Job& job);

/// Lets jobs whose results were made by other code, but by the same command on the same folders, stand for those of the
/// plan: their folder and record take the place of the planned ones. For those who changed a comment and trained for a
/// week.
void accept_other_code(const std::filesystem::path& out, Plan& plan);

/// Now, in UTC, as 2026-01-31T23:59:59Z.
std::string utc_now();

}  // namespace anigen::experiment
