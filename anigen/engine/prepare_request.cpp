#include "anigen/engine/prepare_request.h"

#include <utility>

namespace anigen::engine {

anigen::prepare::PrepareOptions dataset_request(const PrepareOptions& options,
                                                anigen::prepare::PrepareOptions further) {
  anigen::prepare::PrepareOptions dataset = std::move(further);
  anigen::prepare::StepPlan& plan = dataset.plan;
  plan.seed = dataset.tables.split.seed = options.seed;
  plan.variants = options.poses;
  plan.cleaning = anigen::prepare::cleaning_preset(options.cleaning);
  plan.keep_assets = options.keep_assets;
  plan.resolution = options.resolution;
  plan.views.count = options.views;
  plan.views.size = options.view_size;
  plan.condition_views.count = options.condition_views;
  plan.condition_views.size = options.condition_view_size;
  plan.condition_views.front = options.front_cameras;
  plan.views.geometry = plan.condition_views.geometry = options.view_geometry;
  plan.features.model = options.features;
  plan.features.weights = options.feature_weights;
  dataset.tables.split.test_fraction = options.test_fraction;
  dataset.tables.near_skeletons = anigen::prepare::near_skeletons_of_preset(options.cleaning);
  return dataset;
}

void add_sources(const std::vector<std::filesystem::path>& inputs, const PrepareOptions& options,
                 anigen::prepare::PrepareOptions& dataset) {
  dataset.plan.validate();
  if (!inputs.empty()) dataset.sources = anigen::prepare::find_assets(inputs);
  for (auto& creature : anigen::prepare::procedural_sources(options.seed, options.creatures))
    dataset.sources.push_back(std::move(creature));
}

}  // namespace anigen::engine
