#include "anigen/pipeline/generate_assets.h"

#include <cstdio>
#include <utility>

#include "anigen/apps/common/command_line.h"
#include "anigen/apps/generate_arguments.h"
#include "anigen/apps/with_torch/programs.h"
#include "anigen/core/error.h"
#include "anigen/nn/computing.h"
#include "anigen/pipeline/flow_runs.h"

namespace anigen {
namespace {

/// The number of joints that one of three options asks for.
std::int64_t wanted_joints(const GenerateArguments& arguments) {
  const int given = (arguments.joints != 0) + (arguments.joint_density >= 0) + (arguments.level >= 0);
  if (given > 1)
    throw InputError("", "--joints", "of --joints, --joint-density and --joint-level only one may be given");
  if (arguments.level >= 0) return pipeline::joints_of_level(arguments.level);
  if (arguments.joint_density >= 0) return static_cast<std::int64_t>(arguments.joint_density * 60 + 0.5);
  return arguments.joints;
}

/// The runs of both flows, of which --checkpoint finds those that were not named.
pipeline::FlowRuns runs_of(const GenerateArguments& arguments) {
  const pipeline::FlowRuns named{arguments.structure_flow, arguments.latent_flow};
  if (!named.structure.empty() && !named.latents.empty()) return named;
  if (arguments.checkpoint.empty()) {
    throw InputError("", named.structure.empty() ? "--ss-flow" : "--slat-flow",
                     "name the runs of both flows, or the folder of both with --checkpoint");
  }
  return pipeline::find_flow_runs(arguments.checkpoint, wanted_joints(arguments) > 0, named);
}

std::vector<pipeline::NamedPicture> pictures_of(const GenerateArguments& arguments) {
  if (!arguments.dataset.empty())
    return pipeline::pictures_of_dataset(arguments.dataset, arguments.splits, arguments.most);
  if (arguments.image.empty()) throw InputError("", "--image", "which picture? Or name a --dataset and a --split");
  std::vector<pipeline::NamedPicture> pictures = pipeline::pictures_at(arguments.image);
  if (!arguments.normal_map.empty()) {
    if (pictures.size() != 1) throw InputError("", "--normal-map", "is for one picture");
    pictures.front().normal_map = arguments.normal_map;
  }
  return pictures;
}

void set_models(const GenerateArguments& arguments, const CommonOptions& common,
                pipeline::AssetGenerator::Request& models) {
  const pipeline::FlowRuns runs = runs_of(arguments);
  models.structure_flow = runs.structure;
  models.latent_flow = runs.latents;
  models.structure_autoencoder = arguments.structure_autoencoder;
  models.latent_autoencoder = arguments.latent_autoencoder;
  models.device = common.device;
  models.low_memory = arguments.low_memory;
  models.grouping = arguments.grouping;
  if (arguments.averages && arguments.no_averages) throw InputError("", "--use-ema", "contradicts --no-ema");
  if (arguments.averages) models.averages = models::Averages::kAlways;
  if (arguments.no_averages) models.averages = models::Averages::kNever;
  if (arguments.precision == "bf16") models.precision = torch::kBFloat16;
  if (arguments.structure_condition == "color") {
    models.structure_condition = pipeline::StructureCondition::kColor;
  } else if (arguments.structure_condition == "normal") {
    models.structure_condition = pipeline::StructureCondition::kNormal;
  }
}

void set_sampling(const GenerateArguments& arguments, const CommonOptions& common,
                  pipeline::GenerationOptions& sampling) {
  if (common.seed_given) sampling.seed = common.seed;
  sampling.joints = wanted_joints(arguments);
  pipeline::SamplerOverrides &structure = sampling.structure, &latents = sampling.latents;
  if (arguments.structure_strength >= 0) structure.cfg_strength = arguments.structure_strength;
  if (arguments.latent_strength >= 0) latents.cfg_strength = arguments.latent_strength;
  if (arguments.structure_steps != 0) structure.steps = arguments.structure_steps;
  if (arguments.latent_steps != 0) latents.steps = arguments.latent_steps;
  const auto interval = [](const std::vector<double>& ends) { return std::make_pair(ends[0], ends[1]); };
  if (!arguments.structure_interval.empty()) structure.cfg_interval = interval(arguments.structure_interval);
  if (!arguments.latent_interval.empty()) latents.cfg_interval = interval(arguments.latent_interval);
  if (!arguments.solver.empty()) structure.solver = latents.solver = flow::parse_solver(arguments.solver);
}

pipeline::GenerateRequest request_of(const GenerateArguments& arguments, const CommonOptions& common) {
  pipeline::GenerateRequest request;
  set_models(arguments, common, request.models);
  set_sampling(arguments, common, request.sampling);
  request.pictures.background = pipeline::parse_background(arguments.background);
  request.pictures.normals = pipeline::parse_normal_source(arguments.normals);
  request.pictures.matting = arguments.matting;
  request.estimator_weights = arguments.estimator_weights;
  request.finishing = arguments.finishing;
  request.finishing.remove_hidden = !arguments.keep_hidden;
  request.finishing.filter_skin = !arguments.keep_weights;
  if (arguments.no_smoothing) request.finishing.smoothing_iterations = 0;
  request.published_axes = arguments.published_axes;
  request.obj = arguments.obj;
  request.intermediate = arguments.intermediate;
  request.again = arguments.again;
  request.accept_other_code = arguments.accept_other_code;
  request.output = arguments.output;
  request.name = arguments.name;
  return request;
}

}  // namespace

void run_generate(const GenerateArguments& arguments, const CommonOptions& common) {
  nn::set_up_computing(common.threads);
  const auto reports = pipeline::generate_assets(request_of(arguments, common), pictures_of(arguments));
  std::fputs(common.json ? (pipeline::to_json(reports).dump(2) + "\n").c_str() : pipeline::to_text(reports).c_str(),
             stdout);
  std::size_t failed = 0;
  for (const auto& report : reports) failed += report.failure.empty() ? 0 : 1;
  if (failed > 0 && (!arguments.allow_failures || failed == reports.size())) {
    throw Error(std::to_string(failed) + " of " + std::to_string(reports.size()) + " pictures gave no asset");
  }
}

}  // namespace anigen
