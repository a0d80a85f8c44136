#pragma once
#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "anigen/core/json.h"
#include "anigen/prepare/augment/pose_augmentation.h"
#include "anigen/prepare/cleaning/cleaning_options.h"
#include "anigen/prepare/feature_extractor.h"
#include "anigen/prepare/steps/step.h"
#include "anigen/prepare/steps/view_step.h"

namespace anigen::prepare {

/// What to make of every asset.
struct StepPlan {
  /// Of step_words(). Empty: import, asset, skeleton and voxels, and whatever else has a number or a model below.
  std::vector<std::string> steps;
  bool keep_assets = true;  ///< without it, "asset" is not among the steps that an empty list means
  int resolution = 64;      ///< of voxels
  ViewSettings views, condition_views;
  FeatureOptions features;
  std::size_t variants = 0;  ///< posed variants of every asset
  PoseAugmentation poses;
  CleaningOptions cleaning;
  std::uint64_t seed = 0;  ///< of poses and cameras

  /// Whether a word is among the steps, named or by default.
  bool wants(const std::string& word) const;
  /// @throws InputError naming the option: an unknown step, features without a model, sizes out of range
  void validate() const;
};

/// The words --steps knows: import, asset, augment, skeleton, voxels, views, cond_views, features.
const std::vector<std::string>& step_words();

/// For workers and for the files that say how a dataset was made.
Json to_json(const StepPlan& plan);
StepPlan step_plan_from_json(const Json& json);

struct PlannedStep {
  std::unique_ptr<Step> step;
  bool asked = true;  ///< false: only an input of another one; taken as it is when it is there
};

/// The steps after the import, each after its inputs. @param extractor for the features, null when none are wanted
std::vector<PlannedStep> planned_steps(const StepPlan& plan, std::shared_ptr<const FeatureExtractor> extractor);

/// The extractor that the plan wants; null when it wants no features. @param factory may be empty
/// @throws InputError, NotSupportedError when it cannot be made
std::shared_ptr<const FeatureExtractor> make_extractor(const StepPlan& plan, const FeatureExtractorFactory& factory);

}  // namespace anigen::prepare
