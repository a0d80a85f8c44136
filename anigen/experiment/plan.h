#pragma once
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <string>
#include <vector>

#include "anigen/core/config.h"
#include "anigen/experiment/file.h"

namespace anigen::experiment {

/// Value of the text between '{' and '}'. Throws InputError for what it does not know.
using Meaning = std::function<std::string(const std::string& inside)>;

/// `text` with every `{…}` replaced by its meaning; "{{" is a brace. @throws InputError for a brace without its pair
std::string filled_in(const std::string& text, const Meaning& meaning);

/// Replaces placeholders in every text inside a JSON value; keys stay.
Json filled_in(const Json& value, const Meaning& meaning);

/// Resources that a step asks of a cluster: `"resources"` of the step. 0 or empty: nothing said, the cluster's own
/// default.
struct Resources {
  int workers = 1;  ///< array tasks that share one job; only for programs that share their work by leases
  int cpus = 0, gpus = 0;
  double memory_gb = 0, hours = 0;
  std::string partition;
};

/// Lines of a batch script, each with its end.
std::string sbatch_lines(const Resources& resources);

/// One call of a program.
struct Step {
  std::string name, program;
  std::vector<std::string> words;     ///< what stands first on the command line, such as a subcommand
  Json arguments = Json::object();    ///< option → text, number, true, or a list of these
  std::string output;                 ///< option that receives the folder of the results; empty: writes into another's
  std::string writes_into;            ///< step whose folder this one adds to
  std::filesystem::path config;       ///< for anigen-train; absolute
  Json settings = Json::object();     ///< path.to.key → value, for --set; nested objects of the file become paths
  std::vector<std::string> after;     ///< steps that must be done although no argument names them
  double minutes = 0, megabytes = 0;  ///< what the author expects; 0: unknown
  Resources resources;                ///< of a cluster; they decide nothing about the results
};

/// One step of the file with the changes of a variant. @throws InputError
Step read_step(const Experiment& experiment, const Variant& variant, const std::string& name);

/// @throws InputError, with the nearest word, when `steps` has no step of that name; `key` says where it was named
void require_step(const Json& steps, const ConfigReader& reader, const std::string& key, const std::string& name);

/// One program call that the plan holds once, however many variants and seeds need it.
struct Job {
  std::string id;       ///< <step>-<first digits of the key>; name of its folder, record and log
  std::string key;      ///< SHA-256 of all that decides the result, the programs' code too
  std::string content;  ///< the same without the code
  std::string step, program;
  std::filesystem::path folder;  ///< of the results: its own, or that of the step it writes into
  bool writes_into_other = false;
  bool of_other_code = false;         ///< its results are (accept_other_code())
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

/// "variant, seed 1"; empty when there is but one of each.
std::string run_label(const Experiment& experiment, const PlannedRun& run);

struct Plan {
  std::vector<Job> jobs;  ///< an order in which they can run
  std::vector<PlannedRun> runs;
};

/// Inputs of a plan beside the experiment's file.
struct Workplace {
  std::filesystem::path out;       ///< folder of the experiment: jobs/, records/, report
  std::filesystem::path programs;  ///< folder of the executables
  std::string device = "cpu";
  std::filesystem::path report = {};  ///< folder of the report, where experiments share their jobs; empty: `out`

  const std::filesystem::path& report_folder() const { return report.empty() ? out : report; }
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
