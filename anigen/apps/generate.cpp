#include <string>

#include "anigen/apps/common/grouping_options.h"
#include "anigen/apps/common/torch_half.h"
#include "anigen/apps/generate_arguments.h"

namespace {

using namespace anigen;

void add_model_options(CLI::App& app, GenerateArguments& arguments) {
  CLI::Option* image = app.add_option("--image", arguments.image, "Picture, or folder of pictures");
  CLI::Option* dataset =
      app.add_option("--dataset", arguments.dataset, "Instead of --image: the first condition view of its assets")
          ->excludes(image);
  app.add_option("--split", arguments.splits, "Files of the ids of --dataset to use")->needs(dataset);
  app.add_option("--most", arguments.most, "Only so many assets of --dataset; 0: all")
      ->check(whole_number(0))
      ->needs(dataset);
  app.add_option("--checkpoint", arguments.checkpoint,
                 "Folder with the runs of both flows, such as the released ckpts/; of variants the published defaults");
  app.add_option("--ss-flow", arguments.structure_flow, "Run folder of stage 4, trained here or published");
  app.add_option("--slat-flow", arguments.latent_flow, "Run folder of stage 5, trained here or published");
  app.add_option("--ss-dae", arguments.structure_autoencoder, "Run folder of stage 2 [the one its flow names]");
  app.add_option("--slat-dae", arguments.latent_autoencoder, "Run folder of stage 3 [the one its flow names]");
  app.add_option("--output", arguments.output, "Folder; every picture gets one of its name in it")->required();
  app.add_option("--name", arguments.name, "Name of the asset, for one picture");
  app.add_flag("--use-ema", arguments.averages, "Averaged weights [of runs trained here: yes; of published ones: no]");
  app.add_flag("--no-ema", arguments.no_averages, "The weights themselves");
  app.add_option("--precision", arguments.precision, "Of the flows: fp32, or bf16, which takes half the memory")
      ->capture_default_str()
      ->check(CLI::IsMember({"fp32", "bf16"}));
  app.add_flag("--low-memory", arguments.low_memory, "One model in memory at a time; each is read again per picture");
  CLI::Option* again = app.add_flag("--again", arguments.again, "Also make what is there already");
  app.add_flag("--accept-other-code", arguments.accept_other_code,
               "Keep what another build of this program made, when all else is the same")
      ->excludes(again);
  app.add_flag("--allow-failures", arguments.allow_failures, "Exit with 0 when at least one picture gave an asset");
}

void add_picture_options(CLI::App& app, GenerateArguments& arguments) {
  app.add_option("--background", arguments.background,
                 "auto (alpha, else the network, else GrabCut), keep, alpha, grabcut, network")
      ->capture_default_str();
  CLI::Option* network =
      app.add_option("--matting-network", arguments.matting.network, "ONNX file that separates object and background");
  app.add_option("--matting-mean", arguments.matting.mean,
                 "Colours as the network wants them: this is taken from red, green and blue in 0 … 1 [BiRefNet's]")
      ->delimiter(',')
      ->check(number(-1000, 1000))
      ->needs(network)
      ->type_name("R,G,B")
      ->default_str("0.485,0.456,0.406");
  app.add_option("--matting-deviation", arguments.matting.deviation, "Then they are divided by this [BiRefNet's]")
      ->delimiter(',')
      ->check(number(0, 1000, RangeEnds::kOpenBelow))
      ->needs(network)
      ->type_name("R,G,B")
      ->default_str("0.229,0.224,0.225");
  app.add_option("--condition", arguments.structure_condition,
                 "What stage 4 sees: trained (as its config; published runs: normal), color, normal")
      ->capture_default_str()
      ->check(CLI::IsMember({"trained", "color", "normal"}));
  app.add_option("--normals", arguments.normals,
                 "Where normals come from: color (the picture stands in), file (--normal-map, or those of --dataset), "
                 "estimator, flat; auto: file where there is one, else color")
      ->capture_default_str();
  app.add_option("--normal-map", arguments.normal_map, "The normals of one picture");
  app.add_option("--normal-weights", arguments.estimator_weights,
                 "With --normals estimator: dsine.pt (not ours; non-commercial research only)");
}

void add_sampling_options(CLI::App& app, GenerateArguments& arguments) {
  app.add_option("--cfg-scale-ss", arguments.structure_strength,
                 "Extra weight of guidance in stage 4, 0: none [config]")
      ->check(number(0, 1000));
  app.add_option("--cfg-scale", arguments.latent_strength, "Extra weight of guidance in stage 5, 0: none [config]")
      ->check(number(0, 1000));
  app.add_option("--steps-ss", arguments.structure_steps, "Steps of stage 4 [config]")->check(whole_number(1, 100'000));
  app.add_option("--steps", arguments.latent_steps, "Steps of stage 5 [config]")->check(whole_number(1, 100'000));
  app.add_option("--cfg-interval-ss", arguments.structure_interval,
                 "Guide stage 4 only at times between the two [config]")
      ->check(number(0, 1))
      ->expected(2);
  app.add_option("--cfg-interval", arguments.latent_interval,
                 "Guide stage 5 only at times between the two, 1: noise [config]")
      ->check(number(0, 1))
      ->expected(2);
  app.add_option("--solver", arguments.solver, "euler; midpoint and heun take two passes per step [config]")
      ->check(CLI::IsMember({"euler", "midpoint", "heun"}));
  add_grouping_options(app, arguments.grouping);
  app.add_option("--joints", arguments.joints, "Wanted number of joints, for flows trained with it; 0: any")
      ->check(whole_number(0, 10'000));
  app.add_option("--joint-density", arguments.joint_density, "The same as a share of 60 joints, 0 … 1")
      ->check(number(0, 1));
  app.add_option("--joint-level", arguments.level,
                 "The same by the published levels 0 … 4: none, 10, 15, 25, 35 joints")
      ->check(whole_number(0, 4));
}

void add_finishing_options(CLI::App& app, GenerateArguments& arguments) {
  generate::FinishingOptions& finishing = arguments.finishing;
  app.add_option("--reduction", finishing.reduction, "Share of the faces taken away, 0: none")
      ->check(number(0, 1, RangeEnds::kOpenAbove))
      ->capture_default_str();
  app.add_flag("--keep-hidden", arguments.keep_hidden, "Keep faces inside the mesh, close no holes");
  app.add_option("--hidden-views", finishing.views, "From which faces may be seen (published: 1000)")
      ->check(whole_number(1, 100'000))
      ->capture_default_str();
  app.add_flag("--no-filter-skin", arguments.keep_weights, "Keep weights of joints far away along the skeleton");
  app.add_flag("--no-smooth-skin", arguments.no_smoothing, "Leave skin weights as they are decoded");
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
      ->each([&arguments](const std::string& word) { arguments.published_axes = word == "published"; });
  app.add_flag("--obj", arguments.obj, "Also mesh.obj and mesh.rig.json");
  app.add_flag("--intermediate", arguments.intermediate,
               "Also what the stages gave: voxels.png, ss_latents.npz, latents.npz, votes.glb and dense.glb");
}

/// Options that the others leave without effect.
void refuse_ignored(const CLI::App& app, const GenerateArguments& arguments) {
  if (arguments.background != "auto" && arguments.background != "network") {
    refuse_given(app, {"--matting-network", "--matting-mean", "--matting-deviation"},
                 "is not used by --background " + arguments.background);
  }
  if (!arguments.dataset.empty()) refuse_given(app, {"--normal-map"}, "--dataset brings its own maps of normals");
  if (arguments.normals != "auto" && arguments.normals != "file")
    refuse_given(app, {"--normal-map"}, "is not used by --normals " + arguments.normals);
  if (arguments.normals != "estimator") refuse_given(app, {"--normal-weights"}, "are of --normals estimator");
  if (app.get_option("--ss-flow")->count() > 0 && app.get_option("--slat-flow")->count() > 0)
    refuse_given(app, {"--checkpoint"}, "has nothing to add: --ss-flow and --slat-flow name both runs");
  if (arguments.structure_strength == 0) refuse_given(app, {"--cfg-interval-ss"}, "--cfg-scale-ss 0 guides at no time");
  if (arguments.latent_strength == 0) refuse_given(app, {"--cfg-interval"}, "--cfg-scale 0 guides at no time");
  if (arguments.keep_hidden) refuse_given(app, {"--hidden-views"}, "--keep-hidden looks for no hidden faces");
  if (arguments.no_smoothing)
    refuse_given(app, {"--smooth-iterations", "--smooth-alpha"}, "--no-smooth-skin leaves the weights as they are");
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app{
      "Makes a rigged GLB of a picture: mesh, skeleton and skin weights.\n\n"
      "  anigen-generate --image frog.png --ss-flow runs/ss_flow --slat-flow runs/slat_flow --output results\n"
      "  anigen-generate --image photos/ --checkpoint ckpts/ --ss-flow ckpts/anigen/ss_flow_duet\n"
      "    --normals estimator --normal-weights ckpts/dsine/dsine.pt --precision bf16 --low-memory --output results\n"};
  CommonOptions common;
  GenerateArguments arguments;
  add_model_options(app, arguments);
  add_picture_options(app, arguments);
  add_sampling_options(app, arguments);
  add_finishing_options(app, arguments);
  add_common_options(app, common, library_versions());
  return run_command(app, common, argc, argv, [&] {
    refuse_ignored(app, arguments);
    torch_half("generation").generate(arguments, common);
  });
}
