#pragma once
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "anigen/asset/rigged_asset.h"
#include "anigen/core/config.h"
#include "anigen/io/gltf/gltf.h"
#include "anigen/io/rigs/rig_reader.h"
#include "anigen/prepare/metadata.h"
#include "anigen/prepare/poses.h"
#include "anigen/prepare/sources.h"
#include "anigen/prepare/steps.h"

namespace anigen::prepare {

/// The columns of the first step: what was measured of an imported asset, and of a variant also where it came from.
Json import_columns(const AssetRecord& record);

bool is_rejected_pose(const Json& columns);
/// @throws InputError when they are not what this version of the program wrote
AssetRecord record_from_columns(const Json& columns);

/// A step of one asset that could not be done, and why.
struct StepFailure {
  std::string id;           ///< of the asset; empty when the source could not even be identified
  std::size_t variant = 0;  ///< 0: the asset itself, k + 1: its posed variant k
  std::string step;
  std::string fingerprint;  ///< what was tried; the same again is not tried again unless asked for. Empty: the source
                            ///< changed or went away meanwhile, or could not be identified
  std::string reason;
  std::string rule;  ///< of cleaning, when one dropped the asset
};
ANIGEN_JSON_RECORD(StepFailure, id, variant, step, fingerprint, reason, rule)

/// Cost of one step.
struct StepTiming {
  std::string step;
  double seconds = 0;
  std::uint64_t peak_bytes = 0;  ///< most memory in RAM of the whole process meanwhile
};
ANIGEN_JSON_RECORD(StepTiming, step, seconds, peak_bytes)

/// Outcome of one asset: the source itself, or one of its posed variants.
struct AssetOutcome {
  std::string id;
  std::size_t variant = 0;  ///< 0: the source itself, k + 1: its posed variant k
  bool imported = false;    ///< its record holds what the merge needs
  bool rejected_pose = false;
  bool reused = false;  ///< nothing had to be made
  std::vector<StepFailure> failures;
  std::vector<StepTiming> timings;
};
ANIGEN_JSON_RECORD(AssetOutcome, id, variant, imported, rejected_pose, reused, failures, timings)

/// One source to prepare.
struct SourceTask {
  std::size_t number = 0;  ///< of the source in the run
  AssetSource source;
  std::vector<StepFailure> known;  ///< failures that are taken as they are
  std::string id;                  ///< of the content, once somebody computed it
  bool only_identify = false;      ///< find the id and no more
};
ANIGEN_JSON_RECORD(SourceTask, number, source, known, id, only_identify)

struct SourceOutcome {
  std::size_t number = 0;
  std::vector<AssetOutcome> assets;  ///< the source itself first, then its variants
};
ANIGEN_JSON_RECORD(SourceOutcome, number, assets)

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
/// A result that records/<id>.json calls up to date is not made again. A step that fails leaves the others that do not
/// need it to go on. Killed at any moment, the same call goes on from the last step that was recorded.
class SourcePreparer {
 public:
  /// @param extractor for the features; null when the plan wants none
  SourcePreparer(std::filesystem::path out, StepPlan plan, const std::shared_ptr<const FeatureExtractor>& extractor);

  /// @throws WriteError for what is no asset's fault: a full disk, an unwritable folder
  SourceOutcome prepare(const SourceTask& task, const StepObserver& observe) const;

 private:
  struct Root;
  AssetOutcome prepare_asset(const Root& root, AssetJob& job, const SourceTask& task,
                             const StepObserver& observe) const;

  std::filesystem::path out_;
  StepPlan plan_;
  std::vector<Step> steps_;
  io::RigReader reader_;  ///< keeps the shard that was read last open
};

/// Rule for the names of an asset's variants: see StepFailure::variant.
inline std::size_t variant_number(std::size_t k) { return k + 1; }

struct PreparedAsset {
  Asset asset;  ///< normalised into [-0.5, 0.5]³, Z up
  AssetRecord record;
};

/// Reads or generates the asset, normalises it, cleans it and measures it. Creatures are not cleaned.
/// @param reader kept by the caller over many calls, so that shards are not opened for every sample
/// @throws InputError, NotSupportedError for a file that cannot be used, CleanedOut when a rule drops it
PreparedAsset import_asset(const AssetSource& source, const CleaningOptions& cleaning = {},
                           const io::RigReader& reader = io::RigReader());

/// Likewise of an asset in memory. @param name for messages @throws InputError also naming what is unsound in it
PreparedAsset import_asset(Asset asset, const CleaningOptions& cleaning, const std::string& name);

/// Number of vertices got weights that were not in the file, as the importer's notes tell.
std::size_t invented_rows(const std::vector<io::ImportNote>& notes);

}  // namespace anigen::prepare
