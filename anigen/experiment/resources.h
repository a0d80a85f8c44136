#pragma once
#include <string>

#include "anigen/core/config_reader.h"

namespace anigen::experiment {

/// What a step asks of a cluster: `"resources"` of the step. 0 or empty: nothing said, the cluster's own default.
struct Resources {
  int workers = 1;  ///< array tasks that share one job; only for programs that share their work by leases
  int cpus = 0, gpus = 0;
  double memory_gb = 0, hours = 0;
  std::string partition;
};

/// @param program of the step @param word that stands first on its command line @param arguments of the step
/// @throws InputError for numbers out of range, or several workers of a program that cannot share its work
Resources read_resources(ConfigReader& step, const std::string& program, const std::string& word,
                         const Json& arguments);

/// Lines of a batch script, each with its end.
std::string sbatch_lines(const Resources& resources);

}  // namespace anigen::experiment
