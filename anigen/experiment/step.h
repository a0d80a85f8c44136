#pragma once
#include <filesystem>
#include <string>
#include <vector>

#include "anigen/core/json.h"
#include "anigen/experiment/experiment_file.h"
#include "anigen/experiment/resources.h"

namespace anigen::experiment {

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

}  // namespace anigen::experiment
