#pragma once
#include <cstddef>
#include <filesystem>
#include <string>
#include <vector>

#include "anigen/experiment/plan.h"

namespace anigen::experiment {

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
};

/// Runs what is not done, and says what is going on. A job that was interrupted, or failed before, is called again as
/// it was: every program goes on where it stopped. A failure stops only what needs it.
/// @throws Interrupted after Ctrl-C, when running jobs have saved and stopped; InputError when another process runs
/// jobs in the same folder, or `only` names nothing
RunOutcome run_jobs(const std::filesystem::path& out, const Plan& plan, const RunOptions& options);

}  // namespace anigen::experiment
