#pragma once
#include <cstddef>
#include <filesystem>
#include <string>
#include <vector>

#include "anigen/core/json.h"
#include "anigen/experiment/plan.h"

namespace anigen::experiment {

/// Everything `anigen-experiment` is told.
struct ExperimentCommand {
  enum class What { kRun, kStatus, kReport, kClean } what = What::kRun;
  std::filesystem::path file;
  std::vector<std::string> overrides;  ///< path.to.key=value in the experiment's file
  Workplace place;                     ///< `out` empty: runs/<name of the file>; `programs` empty: where this one lies
  std::size_t jobs = 1;                ///< at a time
  int threads = 0;   ///< that they share; 0: all cores, or each its own choice when there is one at a time
  std::string only;  ///< id or step
  bool dry_run = false, slurm = false, accept_other_code = false;
  bool together = false;  ///< other processes may run the same job, see RunOptions
};

/// Does what it is told. @return for people, or as JSON @throws Error when a job failed; what the parts throw
std::string run_experiment_command(ExperimentCommand command, bool json);

/// The plan with states, expected time and disk, as a table and one closing line.
std::string plan_text(const std::filesystem::path& out, const Plan& plan);
Json plan_json(const std::filesystem::path& out, const Plan& plan);

}  // namespace anigen::experiment
