#pragma once
#include <filesystem>
#include <string>
#include <vector>

#include "anigen/experiment/plan.h"

namespace anigen::experiment {

/// The last line of a log that says something, at most so many characters; progress bars count as lines.
std::string last_line(const std::filesystem::path& log, std::size_t most = 100);

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
