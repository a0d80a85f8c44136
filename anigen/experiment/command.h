#pragma once
#include <cstddef>
#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "anigen/core/config.h"
#include "anigen/experiment/plan.h"

namespace anigen::experiment {

/// Minutes of jobs on this machine, by step: the author's minutes times how far they were off for earlier jobs of that
/// step; without such minutes the mean of the earlier jobs. Where a step was never run, the author's word counts.
class Estimates {
 public:
  explicit Estimates(const std::filesystem::path& out);

  double seconds(const Job& job) const;  ///< 0: unknown
  double bytes(const Job& job) const;    ///< of disk; 0: unknown

 private:
  struct Sum {
    double seconds = 0, bytes = 0;
    double stated = 0, expected = 0;  ///< seconds of jobs whose author stated them, and what was stated
    int jobs = 0;
  };
  std::map<std::string, Sum> by_step_;
};

/// "3 h 05 min", "12 min", "40 s"; "?" for 0.
std::string duration_text(double seconds);

/// "1.2 GB", "35 MB"; "?" for 0.
std::string size_text(double bytes);

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
