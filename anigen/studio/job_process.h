#pragma once
#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "anigen/core/job.h"
#include "anigen/core/worker_process.h"
#include "anigen/studio/job_store.h"

namespace anigen::studio {

struct JobProcessOptions {
  std::vector<std::string> command;  ///< of a worker: a program that calls run_job_worker(), with its folder added
  int threads = 0;                   ///< of a job; 0: all cores
  std::uint64_t memory_bytes = std::uint64_t{8} << 30;  ///< resident, of a job and the processes that it starts
  double minutes = 30.0;                                ///< of a job
};

/// Does each job in a process of its own, so that one that crashes, hangs or fills the memory takes no other with it.
/// Generations take turns in one that keeps its models, and is started again after it died; other jobs get a new one.
/// A process writes files in the folder of its job alone, that of generations in the folder of all jobs
/// (core/sandbox.h).
class JobProcesses {
 public:
  explicit JobProcesses(JobProcessOptions options) : options_(std::move(options)) {}

  /// Work of a JobRunner, as JobWork::run() does it, for one generation and one other job at a time; each from one
  /// thread that lives longer than this. A cancelled job has 2 s before its process is killed.
  /// @throws Error with the worker's sentence, or saying that it crashed or passed a limit; Interrupted
  void run(const std::filesystem::path& folder, Job& job, JobRecord& record);

 private:
  std::unique_ptr<WorkerProcess> start(const std::filesystem::path& writable) const;
  Json outcome(WorkerProcess& process, const std::filesystem::path& folder, Job& job, const JobRecord& record) const;
  void refuse_excess(WorkerProcess& process, double seconds) const;

  JobProcessOptions options_;
  std::unique_ptr<WorkerProcess> warm_;  ///< of generations
};

/// The whole life of a worker: jobs by standard input, one after the other, until it ends; progress and outcomes by
/// standard output. Lines, all JSON: {"job": record, "folder": …, "threads": N} and {"cancel": true} to it;
/// {"event": "progress", "stage": …, "fraction": …} and at the end of a job {"event": "done", "job": record},
/// {"event": "interrupted"} or {"event": "failed", "problem": …} from it. @param writable only files below this folder
/// change @return exit status
int run_job_worker(const std::filesystem::path& writable);

}  // namespace anigen::studio
