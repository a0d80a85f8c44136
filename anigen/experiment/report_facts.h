#pragma once
#include <string>

#include "anigen/eval/tables.h"
#include "anigen/experiment/results.h"

namespace anigen::experiment {

/// Where the numbers come from: file, seeds, version, machine, programs.
eval::Table provenance_table(const Experiment& experiment, const Plan& plan, const Workplace& place);

/// Every job with its state, time and memory.
eval::Table job_table(const Plan& plan, const std::filesystem::path& out);

/// "variant, seed 1"; empty when there is but one of each.
std::string run_label(const Experiment& experiment, const PlannedRun& run);

/// How the ± of a table was made, and what its differences are, in a sentence each.
std::string spread_text(const ResultTable& result);
std::string difference_text();

/// "Not run yet: …."; empty when nothing is missing.
std::string missing_text(const ResultTable& result);

}  // namespace anigen::experiment
