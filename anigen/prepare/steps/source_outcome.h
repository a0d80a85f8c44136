#pragma once
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "anigen/core/json.h"
#include "anigen/prepare/asset_source.h"

namespace anigen::prepare {

/// A step of one asset that could not be done, and why.
struct StepFailure {
  std::string id;           ///< of the asset; empty when the source could not even be identified
  std::size_t variant = 0;  ///< 0: the asset itself, k + 1: its posed variant k
  std::string step;
  std::string fingerprint;  ///< what was tried; the same again is not tried again unless asked for
  std::string reason;
  std::string rule;  ///< of cleaning, when one dropped the asset
};

/// What one step cost.
struct StepTiming {
  std::string step;
  double seconds = 0;
  std::uint64_t peak_bytes = 0;  ///< most memory in RAM of the whole process meanwhile
};

/// What became of one asset: the source itself, or one of its posed variants.
struct AssetOutcome {
  std::string id;
  std::size_t variant = 0;  ///< 0: the source itself, k + 1: its posed variant k
  bool imported = false;    ///< its record holds what the merge needs
  bool rejected_pose = false;
  bool reused = false;  ///< nothing had to be made
  std::vector<StepFailure> failures;
  std::vector<StepTiming> timings;
};

/// One source to prepare.
struct SourceTask {
  std::size_t number = 0;  ///< of the source in the run
  AssetSource source;
  std::vector<StepFailure> known;  ///< failures that are taken as they are
  std::string id;                  ///< of the content, once somebody computed it
  bool only_identify = false;      ///< find the id and no more
};

struct SourceOutcome {
  std::size_t number = 0;
  std::vector<AssetOutcome> assets;  ///< the source itself first, then its variants
};

/// What workers and their parent say to each other.
Json to_json(const StepFailure& failure);
StepFailure step_failure_from_json(const Json& json);
Json to_json(const SourceTask& task);
SourceTask source_task_from_json(const Json& json);
Json to_json(const SourceOutcome& outcome);
SourceOutcome source_outcome_from_json(const Json& json);

}  // namespace anigen::prepare
