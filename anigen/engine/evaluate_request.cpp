#include "anigen/engine/evaluate_request.h"

#include <utility>

#include "anigen/eval/protocol.h"

namespace anigen::engine {

eval::PairSettings pair_settings(const EvaluateOptions& options, eval::PairSettings further) {
  eval::PairSettings settings = std::move(further);
  settings.seed = options.seed;
  settings.alignment.icp = options.registration;
  if (!options.normalization.empty())
    settings.alignment.normalization = metrics::normalization_mode(options.normalization);
  settings.merge_joints = options.merge_joints;
  settings.visible_surface = options.visible_surface;
  settings.surface_samples = options.surface_samples;
  if (!options.groups.empty()) settings.groups = {options.groups.begin(), options.groups.end()};
  if (!options.protocol.empty()) eval::apply(eval::evaluation_protocol(options.protocol), settings);
  return settings;
}

}  // namespace anigen::engine
