#pragma once
#include <cstddef>
#include <filesystem>

#include "anigen/core/json.h"
#include "anigen/prepare/feature_extractor.h"
#include "anigen/prepare/steps/step_plan.h"

namespace anigen::prepare {

/// The first line a worker gets.
struct WorkerSettings {
  std::filesystem::path out;
  StepPlan plan;
  int threads = 1;
  std::string log_level = "warn";
};
Json to_json(const WorkerSettings& settings);
WorkerSettings worker_settings_from_json(const Json& json);

/// The whole life of a worker process: settings, then tasks from standard input, messages to standard output, until
/// the input ends (see WorkerPool). Anything that libraries print goes to standard error.
/// @param factory makes the feature extractor; only called when the plan wants features. May be empty
/// @return exit status
int run_worker(const FeatureExtractorFactory& factory);

}  // namespace anigen::prepare
