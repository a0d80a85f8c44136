#pragma once
#include <filesystem>
#include <functional>
#include <memory>
#include <vector>

#include "anigen/io/rigs/rig_reader.h"
#include "anigen/prepare/steps/source_outcome.h"
#include "anigen/prepare/steps/step_plan.h"

namespace anigen::prepare {

/// Called before each step: of which asset, and the fingerprint of what is about to be made.
struct StepBegin {
  std::string id;
  std::size_t variant = 0;
  std::string step, fingerprint;
};
using StepObserver = std::function<void(const StepBegin&)>;

/// Takes sources through the steps of a plan: the source itself, then its posed variants. Made once per process; with
/// no feature extractor prepare() may be called from several threads.
///
/// What records/<id>.json says is up to date is not made again. A step that fails leaves the others that do not need
/// it to go on. Killed at any moment, the same call goes on from the last step that was recorded.
class SourcePreparer {
 public:
  /// @param extractor for the features; null when the plan wants none
  SourcePreparer(std::filesystem::path out, StepPlan plan, std::shared_ptr<const FeatureExtractor> extractor);

  /// @throws WriteError for what is no asset's fault: a full disk, an unwritable folder
  SourceOutcome prepare(const SourceTask& task, const StepObserver& observe) const;

 private:
  struct Root;
  AssetOutcome prepare_asset(const Root& root, AssetJob& job, const SourceTask& task,
                             const StepObserver& observe) const;

  std::filesystem::path out_;
  StepPlan plan_;
  std::vector<PlannedStep> steps_;
  io::RigReader reader_;  ///< keeps the shard that was read last open
};

/// Where variant k of an asset is called a variant: see StepFailure::variant.
inline std::size_t variant_number(std::size_t k) { return k + 1; }

}  // namespace anigen::prepare
