#include "anigen/prepare/steps/step_plan.h"

#include <algorithm>
#include <utility>

#include "anigen/core/config_reader.h"
#include "anigen/core/error.h"
#include "anigen/prepare/steps/feature_step.h"
#include "anigen/prepare/steps/skeleton_step.h"
#include "anigen/prepare/steps/voxel_step.h"

namespace anigen::prepare {
namespace {

/// What the published system renders (reference training-and-data.md, 1.1), for `--steps views` without a number.
constexpr std::size_t kPublishedViews = 150, kPublishedConditionViews = 24;

ViewSettings with_count(ViewSettings settings, std::size_t published, std::uint64_t seed) {
  if (settings.count == 0) settings.count = published;
  settings.seed = seed;
  return settings;
}

void check_views(const ViewSettings& settings, const std::string& option) {
  // Three digits name the pictures of the published layout.
  if (settings.count > 1000) throw InputError("", option, "at most 1000 views");
  if (settings.size < 8 || settings.size > 4096) throw InputError("", option + "-size", "must lie in 8 … 4096 pixels");
  if (settings.samples_per_axis < 1 || settings.samples_per_axis > 16) {
    throw InputError("", "--view-samples", "must lie in 1 … 16");
  }
}

Json to_json(const ViewSettings& settings) {
  return {{"count", settings.count},
          {"size", settings.size},
          {"samples", settings.samples_per_axis},
          {"geometry", settings.geometry},
          {"front", settings.front}};
}

ViewSettings view_settings(const Json& json) {
  ViewSettings settings;
  json.at("count").get_to(settings.count);
  json.at("size").get_to(settings.size);
  json.at("samples").get_to(settings.samples_per_axis);
  json.at("geometry").get_to(settings.geometry);
  settings.front = json.value("front", false);
  return settings;
}

}  // namespace

const std::vector<std::string>& step_words() {
  static const std::vector<std::string> words{"import", "asset", "augment",    "skeleton",
                                              "voxels", "views", "cond_views", "features"};
  return words;
}

bool StepPlan::wants(const std::string& word) const {
  if (word == "augment" && variants > 0) return true;
  if (!steps.empty()) return std::find(steps.begin(), steps.end(), word) != steps.end();
  if (word == "asset") return keep_assets;
  if (word == "views") return views.count > 0;
  if (word == "cond_views") return condition_views.count > 0;
  if (word == "features") return !features.model.empty();
  return word != "augment";
}

void StepPlan::validate() const {
  for (const std::string& word : steps) {
    if (std::find(step_words().begin(), step_words().end(), word) != step_words().end()) continue;
    const std::string near = nearest_word(word, step_words());
    throw InputError("", "--steps",
                     "unknown step \"" + word + "\"" + (near.empty() ? "" : "; did you mean \"" + near + "\"?"));
  }
  if (wants("features") && features.model.empty()) throw InputError("", "--steps", "features need --features MODEL");
  if (wants("augment") && variants == 0) throw InputError("", "--steps", "augment needs --augment K");
  if (resolution < 2 || resolution > 1024) throw InputError("", "--resolution", "must lie in 2 … 1024");
  if (variants > 10000) throw InputError("", "--augment", "at most 10000 variants");
  check_views(views, "--views");
  check_views(condition_views, "--cond-views");
  poses.validate();
  cleaning.validate();
}

Json to_json(const StepPlan& plan) {
  return {
      {"steps", plan.steps},
      {"keep_assets", plan.keep_assets},
      {"resolution", plan.resolution},
      {"views", to_json(plan.views)},
      {"cond_views", to_json(plan.condition_views)},
      {"features",
       {{"model", plan.features.model}, {"weights", plan.features.weights.string()}, {"device", plan.features.device}}},
      {"variants", plan.variants},
      {"own_motion", plan.poses.own_motion},
      {"pose_probability", plan.poses.probability},
      {"pose_max_angle", plan.poses.max_angle},
      {"cleaning", to_json(plan.cleaning)},
      {"seed", plan.seed}};
}

StepPlan step_plan_from_json(const Json& json) {
  StepPlan plan;
  json.at("steps").get_to(plan.steps);
  json.at("keep_assets").get_to(plan.keep_assets);
  json.at("resolution").get_to(plan.resolution);
  plan.views = view_settings(json.at("views"));
  plan.condition_views = view_settings(json.at("cond_views"));
  const Json& features = json.at("features");
  features.at("model").get_to(plan.features.model);
  plan.features.weights = features.at("weights").get<std::string>();
  features.at("device").get_to(plan.features.device);
  json.at("variants").get_to(plan.variants);
  json.at("own_motion").get_to(plan.poses.own_motion);
  json.at("pose_probability").get_to(plan.poses.probability);
  json.at("pose_max_angle").get_to(plan.poses.max_angle);
  plan.cleaning = cleaning_options_from_json(json.at("cleaning"));
  json.at("seed").get_to(plan.seed);
  return plan;
}

std::shared_ptr<const FeatureExtractor> make_extractor(const StepPlan& plan, const FeatureExtractorFactory& factory) {
  if (!plan.wants("features")) return nullptr;
  if (!factory) throw NotSupportedError("", "--features", "features in this program");
  return factory(plan.features);
}

std::vector<PlannedStep> planned_steps(const StepPlan& plan, std::shared_ptr<const FeatureExtractor> extractor) {
  const bool features = plan.wants("features") && extractor != nullptr;
  const bool need_views = features && extractor->needs_views();
  std::vector<PlannedStep> steps;
  const auto add = [&](std::unique_ptr<Step> step, bool asked) { steps.push_back({std::move(step), asked}); };
  if (plan.wants("skeleton")) add(std::make_unique<SkeletonStep>(), true);
  if (plan.wants("asset")) add(std::make_unique<KeepAssetStep>(), true);
  if (plan.wants("voxels") || features) add(std::make_unique<VoxelStep>(plan.resolution), true);
  if (plan.wants("views") || need_views) {
    add(std::make_unique<ViewStep>(with_count(plan.views, kPublishedViews, plan.seed)), plan.wants("views"));
  }
  if (plan.wants("cond_views")) {
    add(std::make_unique<ConditionViewStep>(with_count(plan.condition_views, kPublishedConditionViews, plan.seed)),
        true);
  }
  if (features) add(std::make_unique<FeatureStep>(std::move(extractor), plan.resolution), true);
  return steps;
}

}  // namespace anigen::prepare
