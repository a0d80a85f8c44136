#include "anigen/experiment/slurm.h"

#include <algorithm>
#include <cstdio>
#include <set>

#include "anigen/core/atomic_file.h"
#include "anigen/core/error.h"
#include "anigen/experiment/job_record.h"

namespace anigen::experiment {
namespace {

namespace fs = std::filesystem;

/// The jobs of one step, and the steps that must come first.
struct StepArray {
  std::string step;
  std::vector<std::string> jobs;
  std::set<std::string> after;
};

std::vector<StepArray> arrays_of(const fs::path& out, const Plan& plan) {
  std::vector<StepArray> arrays;
  for (const Job& job : plan.jobs) {
    if (is_done(out, job)) continue;
    auto array = std::find_if(arrays.begin(), arrays.end(), [&](const StepArray& a) { return a.step == job.step; });
    if (array == arrays.end()) array = arrays.insert(arrays.end(), {job.step, {}, {}});
    array->jobs.push_back(job.id);
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
    std::string text = "#!/usr/bin/env bash\n#SBATCH --job-name=" + array.step + "\n#SBATCH --array=0-" +
                       std::to_string(array.jobs.size() - 1) + "\n#SBATCH --output=" + prefix + array.step +
                       "_%a.out\n# Stopped with time to save: the same task, submitted again, goes on.\n"
                       "#SBATCH --signal=B:TERM@120\nset -euo pipefail\njobs=(";
    for (const std::string& job : array.jobs) text += "\n  " + job;
    // Programs that know SLURM arrays themselves, as anigen-prepare does, would take this one for theirs.
    text += ")\njob=${jobs[$SLURM_ARRAY_TASK_ID]}\nunset \"${!SLURM_ARRAY_@}\"\ncd " +
            shell_line({working_folder.string()}) + "\nexec " + shell_line(command) + " \"$job\"\n";
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

}  // namespace anigen::experiment
