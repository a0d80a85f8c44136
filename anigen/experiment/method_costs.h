#pragma once
#include <cstdint>
#include <filesystem>
#include <set>
#include <string>
#include <vector>

#include "anigen/core/table.h"
#include "anigen/experiment/plan.h"
#include "anigen/experiment/run_jobs.h"

namespace anigen::experiment {

/// Cost of one method for an asset: what its call took, start-up included, divided by the assets that it made.
struct MethodCost {
  std::string label;
  std::size_t jobs = 0, wanted = 0;       ///< done ones, over seeds, of those that the plan has
  std::size_t assets = 0;                 ///< of one job
  double seconds = 0;                     ///< of an asset, mean over jobs
  double seconds_before = 0;              ///< of an asset, of the steps that come before, such as generating its mesh
  std::uint64_t peak_bytes = 0;           ///< largest resident set of its jobs, and of those before
  std::int64_t parameters = 0;            ///< of its models; below 0: a run does not say
  std::vector<double> by_job;             ///< seconds of an asset, with those before
  std::set<CoreShare> ran, training_ran;  ///< of its jobs and of those before; of its trainings
  double training_seconds = 0;            ///< of its models, mean over seeds, and of nothing that these trainings need
  std::vector<double> training_by_seed;   ///< one value where no seed changes them; empty while some are not done
};

/// Costs of the rows of one table, from the records of the first variant's jobs that are done.
std::vector<MethodCost> method_costs(const Plan& plan, const std::filesystem::path& out, const CostSpec& spec);

/// Method, seconds, memory, parameters and training as people read them; "–" where nothing has run.
Table method_cost_table(const std::vector<MethodCost>& costs);

Json to_json(const std::vector<MethodCost>& costs);

}  // namespace anigen::experiment
