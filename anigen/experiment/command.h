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
  std::string scale;                   ///< word of its "scales"; empty: none
  Workplace place;       ///< `out` empty: runs/<name of the file>_<scale>; `programs` empty: where this one lies
  std::size_t jobs = 1;  ///< at a time
  int threads = 0;       ///< that they share; 0: all cores, or each its own choice when there is one at a time
  std::string only;      ///< id or step
  bool dry_run = false, slurm = false, accept_other_code = false;
  bool together = false;  ///< other processes may run the same job, see RunOptions
};

/// Does what it is told. Before the first job runs, every program is asked whether it takes the options of its jobs. Of
/// a collection it does so for every experiment: they share their jobs, and have reports in
/// folders of their own below `out`. It goes on where one fails, and writes write_verdicts() after a run and for a
/// report. @return for people, or as JSON @throws Error when a job failed; what the parts throw
std::string run_experiment_command(ExperimentCommand command, bool json);

/// Writes out/slurm: one array job per step, `<n>_<step>.sbatch`, with a task per job of it that is not done, or as
/// many tasks per job as the step has workers, which share the job's work; and submit.sh, which submits them so that a
/// step begins when all of the steps it needs have succeeded. Scripts ask for the step's resources; submit.sh hands its
/// own arguments on to every sbatch, where they count more.
///
/// A task that is told that its time is up, two minutes before, saves, puts itself into the queue again and goes on. So
/// does one whose node failed or that was preempted; one that failed for itself does so twice, unless its input is
/// wrong.
/// @param command how this program runs one job: anigen-experiment run FILE --out … --only
/// @param working_folder where relative paths of the experiment's arguments begin
/// @return the files written @throws Error when they cannot be written
std::vector<std::filesystem::path> write_slurm(const std::filesystem::path& out, const Plan& plan,
                                               const std::vector<std::string>& command,
                                               const std::filesystem::path& working_folder);

}  // namespace anigen::experiment
