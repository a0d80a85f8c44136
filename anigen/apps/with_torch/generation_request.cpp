#include "anigen/apps/with_torch/generation_request.h"

#include <utility>

#include "anigen/core/error.h"
#include "anigen/generate/run_weights.h"

namespace anigen::engine {

namespace {

/// The runs of both flows, of which a folder has those that are not named.
generate::FlowRuns runs_of(const GeneratorOptions& options) {
  const generate::FlowRuns named{options.structure_flow, options.latent_flow};
  if (!named.structure.empty() && !named.latents.empty()) return named;
  // A flow of other weights knows neither the voxels nor the latents of the one that is named.
  if (options.runs.empty() && (!named.structure.empty() || !named.latents.empty())) {
    throw InputError("", named.structure.empty() ? "--ss-flow" : "--slat-flow",
                     "name the runs of both flows, or the folder of both with --runs");
  }
  return generate::find_flow_runs(options.runs.empty() ? generate::shipped_weights() : options.runs,
                                  options.counts_joints, named);
}

}  // namespace

generate::GenerateRequest generation_request(const GeneratorOptions& options, generate::GenerateRequest further) {
  generate::GenerateRequest request = std::move(further);
  const generate::FlowRuns runs = runs_of(options);
  request.models.structure_flow = runs.structure;
  request.models.latent_flow = runs.latents;
  request.models.device = options.device;
  request.models.precision = value_of(nn::kFlowPrecisions, options.precision, "precision");
  request.models.low_memory = options.low_memory;
  // 0: as fitted for the run, whose votes lie wider apart than those of the published one.
  request.models.grouping.bandwidth = 0.0F;
  request.models.grouping.min_cluster_size = 0;
  request.pictures.background = generate::parse_background(options.background);
  request.picture_colors = options.image_colors;
  return request;
}

generate::GenerationOptions sampling_options(const GenerateOptions& options, generate::GenerationOptions further) {
  generate::GenerationOptions sampling = std::move(further);
  if (!options.stop_at.empty() && options.stop_at != "voxels")
    throw InputError("", "stop_at", "\"" + options.stop_at + "\" is no stage to stop at: \"voxels\" is");
  sampling.seed = options.seed;
  sampling.joints = options.joints;
  sampling.structure.steps = options.structure_steps;
  sampling.latents.steps = options.latent_steps;
  // v + s (v − v₀) = v₀ + (1 + s)(v − v₀): the configs' strength s is the guidance scale less 1.
  if (options.structure_guidance) sampling.structure.cfg_strength = *options.structure_guidance - 1;
  if (options.latent_guidance) sampling.latents.cfg_strength = *options.latent_guidance - 1;
  sampling.voxels_alone = !options.stop_at.empty();
  return sampling;
}

generate::MattingOptions with_shipped_matting(generate::MattingOptions asked, generate::Background background) {
  using generate::Background;
  if (asked.network.empty() && (background == Background::kAuto || background == Background::kNetwork))
    asked.network = generate::shipped_matting();
  return asked;
}

}  // namespace anigen::engine
