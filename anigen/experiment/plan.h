#pragma once
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "anigen/experiment/experiment_file.h"
#include "anigen/experiment/resources.h"

namespace anigen::experiment {

/// One program call that the plan holds once, however many variants and seeds need it.
struct Job {
  std::string id;       ///< <step>-<first digits of the key>; name of its folder, record and log
  std::string key;      ///< SHA-256 of all that decides the result, the programs' code too
  std::string content;  ///< the same without the code
  std::string step, program;
  std::filesystem::path folder;  ///< of the results: its own, or that of the step it writes into
  bool writes_into_other = false;
  std::vector<std::string> command;   ///< program and arguments
  std::string program_state;          ///< input_fingerprint() of the program when the plan was made
  std::vector<std::size_t> needs;     ///< jobs that come first, by place in the plan
  std::vector<std::string> serves;    ///< "variant", "variant, seed 1" that need it
  double minutes = 0, megabytes = 0;  ///< what the author expects; 0: unknown
  Resources resources;                ///< of a cluster
};

/// <step>-<10 hexadecimal digits>, as jobs are called.
bool is_job_id(const std::string& name);

/// A variant with a seed: which job is which of its steps.
struct PlannedRun {
  std::size_t variant = 0;
  std::uint64_t seed = 0;
  std::map<std::string, std::size_t> jobs;
};

struct Plan {
  std::vector<Job> jobs;  ///< an order in which they can run
  std::vector<PlannedRun> runs;
};

/// What a plan depends on beside the experiment's file.
struct Workplace {
  std::filesystem::path out;       ///< folder of the experiment: jobs/, records/, report
  std::filesystem::path programs;  ///< folder of the executables
  std::string device = "cpu";
};

/// Names every job by its content: resolved config, arguments, inputs (the jobs it needs, and files named by {path:…}
/// with size and time of change) and code (SHA-256 of the program). What several variants or seeds have in common is
/// therefore one job, and a change re-runs just what depends on it.
///
/// In arguments and settings `{step}` is a step's folder, `{step.name}` the folder's name, `{path:FILE}` a file
/// relative to the experiment's, `{seed}` the seed.
/// @throws InputError for unknown placeholders, steps that wait for each other, a missing program or config
Plan make_plan(const Experiment& experiment, const Workplace& place);

/// A program call as it can be pasted into a shell.
std::string shell_line(const std::vector<std::string>& command);

}  // namespace anigen::experiment
