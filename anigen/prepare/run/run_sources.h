#pragma once
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "anigen/prepare/feature_extractor.h"
#include "anigen/prepare/run/failure_log.h"
#include "anigen/prepare/run/shard.h"
#include "anigen/prepare/run/timing_log.h"
#include "anigen/prepare/steps/step_plan.h"

namespace anigen::prepare {

/// How the work is done; nothing of it shows in the dataset.
struct RunOptions {
  Shard shard;
  std::vector<std::string> worker_command;  ///< empty: in this process, on its threads, without limits
  std::size_t workers = 0;                  ///< processes; 0: as many as threads
  double timeout = 0;                       ///< seconds for one asset; 0: none
  std::uint64_t memory_bytes = 0;           ///< in RAM, per worker; 0: no limit
  bool retry_failed = false;                ///< try again what failed in the same way before
  std::string log_level = "warn";           ///< of workers
  FeatureExtractorFactory features;         ///< for work in this process; workers make their own
};

/// Takes the sources of the shard through the plan, by worker processes or in this process, together with whoever else
/// runs the same: each takes by lease what nobody has or has done. First all are identified, then each content is
/// prepared once; both end when the last process has finished its part.
/// @return what became of them, by whomever, in order of their numbers
/// @pre the caller belongs to the run (RunMembership)
/// @throws Interrupted after Ctrl-C, Error when the disk refuses
std::vector<SourceOutcome> run_sources(const std::filesystem::path& out, const std::vector<AssetSource>& sources,
                                       const StepPlan& plan, const RunOptions& options, FailureLog& failures,
                                       TimingLog& timings);

}  // namespace anigen::prepare
