#include "anigen/prepare/steps/recorded_files.h"

#include <memory>

#include "anigen/prepare/steps/skeleton_step.h"
#include "anigen/prepare/steps/view_step.h"
#include "anigen/prepare/steps/voxel_step.h"

namespace anigen::prepare {
namespace {

constexpr char kFeatures[] = "features/";
constexpr int kAnyResolution = 64;  // decides what is in the files, not where they lie

std::vector<std::unique_ptr<Step>> known_steps() {
  std::vector<std::unique_ptr<Step>> steps;
  steps.push_back(std::make_unique<SkeletonStep>());
  steps.push_back(std::make_unique<KeepAssetStep>());
  steps.push_back(std::make_unique<VoxelStep>(kAnyResolution));
  steps.push_back(std::make_unique<ViewStep>(ViewSettings{}));
  steps.push_back(std::make_unique<ConditionViewStep>(ViewSettings{}));
  return steps;
}

}  // namespace

std::vector<std::filesystem::path> recorded_files(const std::string& step, const Json& options,
                                                  const AssetPlaces& places) {
  static const std::vector<std::unique_ptr<Step>> steps = known_steps();
  if (step.rfind(kFeatures, 0) == 0) return {places.features(step.substr(sizeof kFeatures - 1))};
  for (const std::unique_ptr<Step>& known : steps) {
    if (known->name() == step) return known->outputs(places, options);
  }
  return {};
}

}  // namespace anigen::prepare
