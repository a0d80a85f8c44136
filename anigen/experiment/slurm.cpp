#include "anigen/experiment/slurm.h"

#include <algorithm>
#include <fstream>
#include <set>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/experiment/run_jobs.h"

namespace anigen::experiment {

std::string last_line(const std::filesystem::path& log, std::size_t most) {
  std::ifstream stream(log, std::ios::binary | std::ios::ate);
  if (!stream) return "";
  constexpr std::streamoff kTail = 4096;
  const std::streamoff size = stream.tellg();
  stream.seekg(std::max<std::streamoff>(0, size - kTail));
  std::string text((std::istreambuf_iterator<char>(stream)), {});
  while (!text.empty() && (text.back() == '\n' || text.back() == '\r' || text.back() == ' ')) text.pop_back();
  const std::size_t line = text.find_last_of("\r\n");
  if (line != std::string::npos) text.erase(0, line + 1);
  return text.size() <= most ? text : text.substr(0, most - 3) + "...";
}

namespace {

namespace fs = std::filesystem;

/// The jobs of one step, and the steps that must come first.
struct StepArray {
  std::string step;
  std::vector<std::string> jobs;
  std::set<std::string> after;
  Resources resources;  ///< the most that any of the jobs asks for, since variants may change them
};

Resources larger(Resources a, const Resources& b) {
  a.workers = std::max(a.workers, b.workers);
  a.cpus = std::max(a.cpus, b.cpus);
  a.gpus = std::max(a.gpus, b.gpus);
  a.memory_gb = std::max(a.memory_gb, b.memory_gb);
  a.hours = std::max(a.hours, b.hours);
  if (a.partition.empty()) a.partition = b.partition;
  return a;
}

std::vector<StepArray> arrays_of(const fs::path& out, const Plan& plan) {
  std::vector<StepArray> arrays;
  for (const Job& job : plan.jobs) {
    if (is_done(out, job)) continue;
    auto array = std::find_if(arrays.begin(), arrays.end(), [&](const StepArray& a) { return a.step == job.step; });
    if (array == arrays.end()) array = arrays.insert(arrays.end(), {job.step, {}, {}, job.resources});
    array->jobs.push_back(job.id);
    array->resources = larger(array->resources, job.resources);
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

/// Starts the program, passes on that time is up, and decides whether the task comes back.
constexpr char kRunAndComeBack[] = R"sh(status=0
child=
trap '[ -z "$child" ] || kill -TERM "$child" 2> /dev/null || true' TERM
"${call[@]}" &
child=$!
wait "$child" || status=$?
# A signal ends the waiting, not the program.
while kill -0 "$child" 2> /dev/null; do status=0; wait "$child" || status=$?; done
come_back() { if [ "${SLURM_RESTART_COUNT:-0}" -lt "$1" ]; then scontrol requeue "$SLURM_JOB_ID" || true; fi; }
case $status in
  0 | 2) ;;                 # done; wrong input, which stays wrong
  130) come_back 100 ;;     # saved because time was up
  *) come_back 2 ;;         # failed: a second and a third try
esac
exit $status
)sh";

std::string script(const StepArray& array, const std::string& name, const std::vector<std::string>& command,
                   const fs::path& working_folder) {
  const auto workers = static_cast<std::size_t>(array.resources.workers);
  std::string text = "#!/usr/bin/env bash\n#SBATCH --job-name=" + array.step + "\n#SBATCH --array=0-" +
                     std::to_string(array.jobs.size() * workers - 1) + "\n#SBATCH --output=" + name + "_%a.out\n" +
                     sbatch_lines(array.resources) +
                     "#SBATCH --requeue\n#SBATCH --open-mode=append\n#SBATCH --signal=B:TERM@120\n"
                     "set -euo pipefail\njobs=(";
  for (const std::string& job : array.jobs) text += "\n  " + job;
  text += "\n)\n";
  std::string call = shell_line(command);
  if (workers > 1) {
    text += "workers=" + std::to_string(workers) + "  # tasks that share a job\n" +
            "job=${jobs[$((SLURM_ARRAY_TASK_ID / workers))]}\n";
    call += " \"$job\" --together";
  } else {
    text += "job=${jobs[$SLURM_ARRAY_TASK_ID]}\n";
    call += " \"$job\"";
  }
  return text + "cd " + shell_line({working_folder.string()}) + "\ncall=(" + call + ")\n" + kRunAndComeBack;
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
    const std::string text = script(array, prefix + array.step, command, working_folder);
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
