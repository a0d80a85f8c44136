#include <cstdio>
#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include "anigen/apps/common/command_line.h"
#include "anigen/apps/common/grouping_options.h"
#include "anigen/apps/common/ranges.h"
#include "anigen/core/error.h"
#include "anigen/nn/blas.h"
#include "anigen/nn/computing.h"
#include "anigen/pipeline/flow_runs.h"
#include "anigen/pipeline/generate_assets.h"

namespace {

using namespace anigen;

struct Words {
  std::string image, dataset, checkpoint, solver;
  std::vector<std::filesystem::path> splits;
  std::filesystem::path normal_map;
  std::size_t most = 0;
  std::string background = "auto", normals = "auto", structure_condition = "trained", precision = "fp32";
  std::vector<double> structure_interval, latent_interval;
  double structure_strength = -1, latent_strength = -1, rescale = 0, joint_density = -1;
  std::int64_t structure_steps = 0, latent_steps = 0, joints = 0;
  int level = -1;
  bool allow_failures = false;
  bool averages = false, no_averages = false, keep_hidden = false, keep_weights = false, no_smoothing = false;
};

void add_model_options(CLI::App& app, pipeline::GenerateRequest& request, Words& words) {
  CLI::Option* image = app.add_option("--image", words.image, "Picture, or folder of pictures");
  CLI::Option* dataset =
      app.add_option("--dataset", words.dataset, "Instead of --image: the first condition view of its assets")
          ->excludes(image);
  app.add_option("--split", words.splits, "Files of the ids of --dataset to use")->needs(dataset);
  app.add_option("--most", words.most, "Only so many assets of --dataset; 0: all")
      ->check(whole_number(0))
      ->needs(dataset);
  app.add_option("--checkpoint", words.checkpoint,
                 "Folder with the runs of both flows, such as the released ckpts/; of variants the published defaults");
  app.add_option("--ss-flow", request.models.structure_flow, "Run folder of stage 4, trained here or published");
  app.add_option("--slat-flow", request.models.latent_flow, "Run folder of stage 5, trained here or published");
  app.add_option("--ss-dae", request.models.structure_autoencoder, "Run folder of stage 2 [the one its flow names]");
  app.add_option("--slat-dae", request.models.latent_autoencoder, "Run folder of stage 3 [the one its flow names]");
  app.add_option("--output", request.output, "Folder; every picture gets one of its name in it")->required();
  app.add_option("--name", request.name, "Name of the asset, for one picture");
  app.add_flag("--use-ema", words.averages, "Averaged weights [of runs trained here: yes; of published ones: no]");
  app.add_flag("--no-ema", words.no_averages, "The weights themselves");
  app.add_option("--precision", words.precision, "Of the flows: fp32, or bf16, which takes half the memory")
      ->capture_default_str()
      ->check(CLI::IsMember({"fp32", "bf16"}));
  app.add_flag("--low-memory", request.models.low_memory,
               "One model in memory at a time; each is read again per picture");
  CLI::Option* again = app.add_flag("--again", request.again, "Also make what is there already");
  app.add_flag("--accept-other-code", request.accept_other_code,
               "Keep what another build of this program made, when all else is the same")
      ->excludes(again);
  app.add_flag("--allow-failures", words.allow_failures, "Exit with 0 when at least one picture gave an asset");
}

void add_picture_options(CLI::App& app, pipeline::GenerateRequest& request, Words& words) {
  app.add_option("--background", words.background,
                 "auto (alpha, else the network, else GrabCut), keep, alpha, grabcut, network")
      ->capture_default_str();
  CLI::Option* network = app.add_option("--matting-network", request.pictures.matting.network,
                                        "ONNX file that separates object and background");
  app.add_option("--matting-mean", request.pictures.matting.mean,
                 "Colours as the network wants them: this is taken from red, green and blue in 0 … 1 [BiRefNet's]")
      ->delimiter(',')
      ->check(number(-1000, 1000))
      ->needs(network)
      ->type_name("R,G,B")
      ->default_str("0.485,0.456,0.406");
  app.add_option("--matting-deviation", request.pictures.matting.deviation,
                 "Then they are divided by this [BiRefNet's]")
      ->delimiter(',')
      ->check(number(0, 1000, RangeEnds::kOpenBelow))
      ->needs(network)
      ->type_name("R,G,B")
      ->default_str("0.229,0.224,0.225");
  app.add_option("--condition", words.structure_condition,
                 "What stage 4 sees: trained (as its config; published runs: normal), color, normal")
      ->capture_default_str()
      ->check(CLI::IsMember({"trained", "color", "normal"}));
  app.add_option("--normals", words.normals,
                 "Where normals come from: color (the picture stands in), file (--normal-map, or those of --dataset), "
                 "estimator, flat; auto: file where there is one, else color")
      ->capture_default_str();
  app.add_option("--normal-map", words.normal_map, "The normals of one picture");
  app.add_option("--normal-weights", request.estimator_weights,
                 "With --normals estimator: dsine.pt (not ours; non-commercial research only)");
}

void add_sampling_options(CLI::App& app, pipeline::GenerateRequest& request, Words& words) {
  app.add_option("--cfg-scale-ss", words.structure_strength, "Extra weight of guidance in stage 4, 0: none [config]")
      ->check(number(0, 1000));
  app.add_option("--cfg-scale", words.latent_strength, "Extra weight of guidance in stage 5, 0: none [config]")
      ->check(number(0, 1000));
  app.add_option("--steps-ss", words.structure_steps, "Steps of stage 4 [config]")->check(whole_number(1, 100'000));
  app.add_option("--steps", words.latent_steps, "Steps of stage 5 [config]")->check(whole_number(1, 100'000));
  app.add_option("--cfg-interval-ss", words.structure_interval, "Guide stage 4 only at times between the two [config]")
      ->check(number(0, 1))
      ->expected(2);
  app.add_option("--cfg-interval", words.latent_interval,
                 "Guide stage 5 only at times between the two, 1: noise [config]")
      ->check(number(0, 1))
      ->expected(2);
  app.add_option("--solver", words.solver, "euler; midpoint and heun take two passes per step [config]")
      ->check(CLI::IsMember(flow::solver_words()));
  add_grouping_options(app, request.models.grouping);
  app.add_option("--joints", words.joints, "Wanted number of joints, for flows trained with it; 0: any")
      ->check(whole_number(0, 10'000));
  app.add_option("--joint-density", words.joint_density, "The same as a share of 60 joints, 0 … 1")
      ->check(number(0, 1));
  app.add_option("--joint-level", words.level, "The same by the published levels 0 … 4: none, 10, 15, 25, 35 joints")
      ->check(whole_number(0, 4));
}

void add_finishing_options(CLI::App& app, pipeline::GenerateRequest& request, Words& words) {
  pipeline::FinishingOptions& finishing = request.finishing;
  app.add_option("--reduction", finishing.reduction, "Share of the faces taken away, 0: none")
      ->check(number(0, 1, RangeEnds::kOpenAbove))
      ->capture_default_str();
  app.add_flag("--keep-hidden", words.keep_hidden, "Keep faces inside the mesh, close no holes");
  app.add_option("--hidden-views", finishing.views, "From which faces may be seen (published: 1000)")
      ->check(whole_number(1, 100'000))
      ->capture_default_str();
  app.add_flag("--no-filter-skin", words.keep_weights, "Keep weights of joints far away along the skeleton");
  app.add_flag("--no-smooth-skin", words.no_smoothing, "Leave skin weights as they are decoded");
  app.add_option("--smooth-iterations", finishing.smoothing_iterations, "Of skin weights")
      ->check(whole_number(0, 1'000'000))
      ->capture_default_str();
  app.add_option("--smooth-alpha", finishing.smoothing_alpha, "Share of the neighbours")
      ->check(number(0, 1))
      ->capture_default_str();
  app.add_option("--texture-size", finishing.texture_size, "Texels along a side, 64 or more; 0: vertex colours")
      ->check(whole_number(0, 8192))
      ->capture_default_str();
  app.add_option("--axes", "gltf, or published: (-x, z, y), turned by 180 degrees about the vertical")
      ->default_str("gltf")
      ->check(CLI::IsMember({"gltf", "published"}))
      ->each([&request](const std::string& word) { request.published_axes = word == "published"; });
  app.add_flag("--obj", request.obj, "Also mesh.obj and mesh.rig.json");
  app.add_flag("--intermediate", request.intermediate,
               "Also what the stages gave: voxels.png, ss_latents.npz, latents.npz, votes.glb and dense.glb");
}

/// Options that the others leave without effect.
void refuse_ignored(const CLI::App& app, const Words& words) {
  if (words.background != "auto" && words.background != "network") {
    refuse_given(app, {"--matting-network", "--matting-mean", "--matting-deviation"},
                 "is not used by --background " + words.background);
  }
  if (!words.dataset.empty()) refuse_given(app, {"--normal-map"}, "--dataset brings its own maps of normals");
  if (words.normals != "auto" && words.normals != "file")
    refuse_given(app, {"--normal-map"}, "is not used by --normals " + words.normals);
  if (words.normals != "estimator") refuse_given(app, {"--normal-weights"}, "are of --normals estimator");
  if (app.get_option("--ss-flow")->count() > 0 && app.get_option("--slat-flow")->count() > 0)
    refuse_given(app, {"--checkpoint"}, "has nothing to add: --ss-flow and --slat-flow name both runs");
  if (words.structure_strength == 0) refuse_given(app, {"--cfg-interval-ss"}, "--cfg-scale-ss 0 guides at no time");
  if (words.latent_strength == 0) refuse_given(app, {"--cfg-interval"}, "--cfg-scale 0 guides at no time");
  if (words.keep_hidden) refuse_given(app, {"--hidden-views"}, "--keep-hidden looks for no hidden faces");
  if (words.no_smoothing)
    refuse_given(app, {"--smooth-iterations", "--smooth-alpha"}, "--no-smooth-skin leaves the weights as they are");
}

/// The number of joints that one of three options asks for.
std::int64_t wanted_joints(const Words& words) {
  const int given = (words.joints != 0) + (words.joint_density >= 0) + (words.level >= 0);
  if (given > 1)
    throw InputError("", "--joints", "of --joints, --joint-density and --joint-level only one may be given");
  if (words.level >= 0) return pipeline::joints_of_level(words.level);
  if (words.joint_density >= 0) {
    if (words.joint_density > 1) throw InputError("", "--joint-density", "must lie in 0 … 1");
    return static_cast<std::int64_t>(words.joint_density * 60 + 0.5);
  }
  if (words.joints < 0) throw InputError("", "--joints", "must not be negative");
  return words.joints;
}

/// What --checkpoint leaves to be found.
void find_runs(pipeline::GenerateRequest& request, const Words& words) {
  std::filesystem::path &structure = request.models.structure_flow, &latents = request.models.latent_flow;
  if (!structure.empty() && !latents.empty()) return;
  if (words.checkpoint.empty()) {
    throw InputError("", structure.empty() ? "--ss-flow" : "--slat-flow",
                     "name the runs of both flows, or the folder of both with --checkpoint");
  }
  const pipeline::FlowRuns found =
      pipeline::find_flow_runs(words.checkpoint, wanted_joints(words) > 0, {structure, latents});
  structure = found.structure;
  latents = found.latents;
}

std::vector<pipeline::NamedPicture> pictures_of(const Words& words) {
  if (!words.dataset.empty()) return pipeline::pictures_of_dataset(words.dataset, words.splits, words.most);
  if (words.image.empty()) throw InputError("", "--image", "which picture? Or name a --dataset and a --split");
  std::vector<pipeline::NamedPicture> pictures = pipeline::pictures_at(words.image);
  if (!words.normal_map.empty()) {
    if (pictures.size() != 1) throw InputError("", "--normal-map", "is for one picture");
    pictures.front().normal_map = words.normal_map;
  }
  return pictures;
}

void settle(pipeline::GenerateRequest& request, const Words& words, const CommonOptions& common) {
  find_runs(request, words);
  if (common.seed_given) request.sampling.seed = common.seed;
  request.models.device = common.device;
  if (words.averages && words.no_averages) throw InputError("", "--use-ema", "contradicts --no-ema");
  if (words.averages) request.models.averages = models::Averages::kAlways;
  if (words.no_averages) request.models.averages = models::Averages::kNever;
  if (words.precision == "bf16") request.models.precision = torch::kBFloat16;
  request.pictures.background = pipeline::parse_background(words.background);
  request.pictures.normals = pipeline::parse_normal_source(words.normals);
  if (words.structure_condition == "color") {
    request.models.structure_condition = pipeline::StructureCondition::kColor;
  } else if (words.structure_condition == "normal") {
    request.models.structure_condition = pipeline::StructureCondition::kNormal;
  }
  pipeline::SamplerOverrides &structure = request.sampling.structure, &latents = request.sampling.latents;
  if (words.structure_strength >= 0) structure.cfg_strength = words.structure_strength;
  if (words.latent_strength >= 0) latents.cfg_strength = words.latent_strength;
  if (words.structure_steps != 0) structure.steps = words.structure_steps;
  if (words.latent_steps != 0) latents.steps = words.latent_steps;
  const auto interval = [](const std::vector<double>& ends) { return std::make_pair(ends[0], ends[1]); };
  if (!words.structure_interval.empty()) structure.cfg_interval = interval(words.structure_interval);
  if (!words.latent_interval.empty()) latents.cfg_interval = interval(words.latent_interval);
  if (!words.solver.empty()) structure.solver = latents.solver = flow::parse_solver(words.solver);
  request.sampling.joints = wanted_joints(words);
  request.finishing.remove_hidden = !words.keep_hidden;
  request.finishing.filter_skin = !words.keep_weights;
  if (words.no_smoothing) request.finishing.smoothing_iterations = 0;
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app{
      "Makes a rigged GLB of a picture: mesh, skeleton and skin weights.\n\n"
      "  anigen-generate --image frog.png --ss-flow runs/ss_flow --slat-flow runs/slat_flow --output results\n"
      "  anigen-generate --image photos/ --checkpoint ckpts/ --ss-flow ckpts/anigen/ss_flow_duet\n"
      "    --normals estimator --normal-weights ckpts/dsine/dsine.pt --precision bf16 --low-memory --output results\n"};
  CommonOptions common;
  pipeline::GenerateRequest request;
  Words words;
  add_model_options(app, request, words);
  add_picture_options(app, request, words);
  add_sampling_options(app, request, words);
  add_finishing_options(app, request, words);
  add_common_options(app, common, nn::version_details);
  return run_command(app, common, argc, argv, [&] {
    nn::set_up_computing(common.threads);
    refuse_ignored(app, words);
    settle(request, words, common);
    const auto reports = pipeline::generate_assets(request, pictures_of(words));
    std::fputs(common.json ? (pipeline::to_json(reports).dump(2) + "\n").c_str() : pipeline::to_text(reports).c_str(),
               stdout);
    std::size_t failed = 0;
    for (const auto& report : reports) failed += report.failure.empty() ? 0 : 1;
    if (failed > 0 && (!words.allow_failures || failed == reports.size())) {
      throw Error(std::to_string(failed) + " of " + std::to_string(reports.size()) + " pictures gave no asset");
    }
  });
}
