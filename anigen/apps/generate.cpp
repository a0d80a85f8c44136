#include "anigen/apps/common/command_line.h"
#include "anigen/apps/common/torch_half.h"
#include "anigen/apps/generate_arguments.h"
#include "anigen/core/error.h"
#include "anigen/io/rigs/rig_listing.h"

namespace {

using namespace anigen;

void add_model_options(CLI::App& app, GenerateArguments& arguments) {
  CLI::Option* image = add_option(app, "--image", arguments.images, "; several may follow");
  add_option(app, "--one-object", arguments.one_object)->needs(image);
  CLI::Option* dataset =
      add_option(app, "--dataset", arguments.dataset, ", instead of --image: the first condition view of its assets")
          ->excludes(image);
  add_option(app, "--split", arguments.splits)->needs(dataset);
  add_option(app, "--image-views", arguments.image_views)->check(whole_number(1, generate::kMostViews))->needs(dataset);
  add_option(app, "--limit", arguments.limit)->check(whole_number(0))->needs(dataset);
  add_option(
      app, "--output", arguments.output,
      ": folder, every image gets one of its name in it; or of one image the file: .glb, .gltf, .fbx, .usda, .usdz")
      ->required();
  add_option(app, "--asset-name", arguments.asset_name);
  add_option(app, "--runs", arguments.models.runs);
  add_option(app, "--ss-flow", arguments.models.structure_flow);
  add_option(app, "--slat-flow", arguments.models.latent_flow);
  add_option(app, "--ss-dae", arguments.structure_autoencoder);
  add_option(app, "--slat-dae", arguments.latent_autoencoder);
  CLI::Option* averages = add_option(app, "--use-ema", arguments.averages);
  add_option(app, "--no-ema", arguments.no_averages)->excludes(averages);
  add_option(app, "--precision", arguments.models.precision);
  add_option(app, "--low-memory", arguments.models.low_memory);
  CLI::Option* force = add_option(app, "--force", arguments.force);
  add_option(app, "--accept-other-code", arguments.accept_other_code)->excludes(force);
}

void add_picture_options(CLI::App& app, GenerateArguments& arguments) {
  add_option(app, "--background", arguments.models.background,
             " or network; auto: alpha, else the network, else GrabCut")
      ->check(one_of({"auto", "keep", "alpha", "grabcut", "network"}));
  add_option(app, "--mask", arguments.mask)->excludes(app.get_option("--dataset"));
  CLI::Option* network = add_option(app, "--matting-network", arguments.matting.network);
  add_option(app, "--matting-mean", arguments.matting.mean)
      ->delimiter(',')
      ->check(number(-1000, 1000))
      ->needs(network)
      ->default_str("0.485,0.456,0.406");
  add_option(app, "--matting-deviation", arguments.matting.deviation)
      ->delimiter(',')
      ->check(number(0, 1000, RangeEnds::kOpenBelow))
      ->needs(network)
      ->default_str("0.229,0.224,0.225");
  add_option(app, "--condition", arguments.structure_condition,
             ", by stage 4; trained: as its config (published runs: normal)")
      ->check(one_of({"trained", "color", "normal"}));
  add_option(app, "--normals", arguments.normals);
  add_option(app, "--normal-map", arguments.normal_map);
  add_option(app, "--normal-weights", arguments.estimator_weights);
}

void add_sampling_options(CLI::App& app, GenerateArguments& arguments) {
  CLI::Option* stop =
      add_option(app, "--stop-at", arguments.sampling.stop_at, ": voxels, after stage 4")->check(one_of({"voxels"}));
  add_option(app, "--voxels", arguments.voxels)->excludes(stop)->excludes(app.get_option("--dataset"));
  add_option(app, "--ss-guidance", arguments.sampling.structure_guidance)->check(number(1, 1001));
  add_option(app, "--slat-guidance", arguments.sampling.latent_guidance)->check(number(1, 1001));
  add_option(app, "--ss-steps", arguments.sampling.structure_steps)->check(whole_number(1, 100'000));
  add_option(app, "--slat-steps", arguments.sampling.latent_steps)->check(whole_number(1, 100'000));
  add_option(app, "--ss-interval", arguments.structure_interval)->check(number(0, 1))->expected(2);
  add_option(app, "--slat-interval", arguments.latent_interval)->check(number(0, 1))->expected(2);
  add_option(app, "--solver", arguments.solver);
  add_option(app, "--guidance-every", arguments.guidance_every)->check(whole_number(1, 100'000));
  add_option(app, "--velocity-tolerance", arguments.velocity_tolerance)->check(number(0, 1));
  add_option(app, "--windowed-steps", arguments.windowed_steps)->check(whole_number(0, 100'000));
  add_option(app, "--view-rule", arguments.view_rule);
  CLI::Option* joints = add_option(app, "--joints", arguments.sampling.joints, ", for flows trained with it")
                            ->check(whole_number(0, 10'000));
  CLI::Option* density = add_option(app, "--joint-density", arguments.joint_density)->check(number(0, 1));
  add_option(app, "--joint-level", arguments.joint_level)
      ->check(whole_number(0, 4))
      ->excludes(joints)
      ->excludes(density->excludes(joints));
}

void add_finishing_options(CLI::App& app, GenerateArguments& arguments) {
  generate::FinishingOptions& finishing = arguments.finishing;
  add_clustering_options(app, arguments.clustering);
  add_option(app, "--reduction", finishing.reduction)->check(number(0, 1, RangeEnds::kOpenAbove));
  add_option(app, "--keep-hidden", arguments.keep_hidden);
  add_option(app, "--hidden-views", finishing.views)->check(whole_number(1, 100'000));
  add_option(app, "--no-filter-skin", arguments.keep_weights);
  add_option(app, "--no-smooth-skin", arguments.no_smoothing);
  add_option(app, "--smooth-iterations", finishing.smoothing_iterations, " [as fitted for the run, else 100]")
      ->check(whole_number(0, 1'000'000));
  add_option(app, "--smooth-alpha", finishing.smoothing_alpha)->check(number(0, 1));
  CLI::Option* rigid = add_option(app, "--rigid-parts", finishing.rigid_parts);
  add_option(app, "--rigid-share", finishing.rigid_share)->check(number(0.5, 1, RangeEnds::kOpenBelow))->needs(rigid);
  add_option(app, "--texture-size", finishing.texture_size)->check(whole_number(0, 8192));
  add_option(app, "--colors", arguments.colors);
  add_option(app, "--axes", arguments.axes);
  add_option(app, "--still", arguments.still);
  add_option(app, "--obj", arguments.obj);
  add_option(app, "--intermediate", arguments.intermediate);
}

/// Options of the stages that do not run.
void refuse_other_stages(const CLI::App& app, const GenerateArguments& arguments) {
  if (!arguments.voxels.empty()) {
    refuse_given(app,
                 {"--ss-guidance", "--ss-steps", "--ss-interval", "--ss-dae", "--condition", "--normals",
                  "--normal-map", "--normal-weights"},
                 "applies to stage 4, which --voxels leaves out");
  }
  if (arguments.sampling.stop_at.empty()) return;
  refuse_given(app,
               {"--slat-guidance", "--slat-steps", "--slat-interval", "--joints", "--joint-density", "--joint-level"},
               "applies to stage 5; --stop-at voxels ends before it");
  refuse_given(
      app,
      {"--cluster-algorithm", "--cluster-bandwidth", "--cluster-min-votes", "--reduction", "--keep-hidden",
       "--hidden-views", "--no-filter-skin", "--no-smooth-skin", "--smooth-iterations", "--smooth-alpha",
       "--rigid-parts", "--rigid-share", "--texture-size", "--colors", "--axes", "--still", "--obj", "--intermediate"},
      "applies to the mesh; --stop-at voxels ends before it");
}

/// Names of files in formats that assets are not written in: a folder of such a name is hardly meant.
void refuse_other_formats(const std::filesystem::path& output) {
  if (!io::has_extension(output, {".vrm", ".obj", ".ply", ".stl", ".dae", ".3mf", ".usd", ".usdc"}) ||
      std::filesystem::is_directory(output))
    return;
  const bool is_vrm = io::has_extension(output, {".vrm"}), is_obj = io::has_extension(output, {".obj"});
  throw InputError(output.string(), "--output",
                   "an asset's file is a .glb, .gltf, .fbx, .usda or .usdz" +
                       std::string(is_vrm   ? "; anigen-rig makes a .vrm of a .glb"
                                   : is_obj ? "; --obj writes an OBJ beside it, into a folder"
                                            : ""));
}

/// Options that the others leave without effect.
void refuse_ignored(const CLI::App& app, const GenerateArguments& arguments) {
  refuse_other_stages(app, arguments);
  if (!arguments.mask.empty()) {
    refuse_given(app, {"--background", "--matting-network", "--matting-mean", "--matting-deviation"},
                 "is not used: --mask says where the object is");
  }
  if (arguments.models.background != "auto" && arguments.models.background != "network") {
    refuse_given(app, {"--matting-network", "--matting-mean", "--matting-deviation"},
                 "is not used by --background " + arguments.models.background);
  }
  if (arguments.matting.is_run()) {
    refuse_given(
        app, {"--matting-mean", "--matting-deviation"},
        "applies only to ONNX files; " + arguments.matting.network.string() + " is a trained run, which needs none");
  }
  if (!arguments.one_object && arguments.image_views < 2)
    refuse_given(app, {"--view-rule"}, "applies only to several views: --one-object, or --image-views of a --dataset");
  if (!arguments.dataset.empty()) refuse_given(app, {"--normal-map"}, "--dataset brings its own maps of normals");
  if (arguments.normals != "auto" && arguments.normals != "file")
    refuse_given(app, {"--normal-map"}, "is not used by --normals " + arguments.normals);
  if (arguments.normals != "estimator")
    refuse_given(app, {"--normal-weights"}, "applies only with --normals estimator");
  if (app.get_option("--ss-flow")->count() > 0 && app.get_option("--slat-flow")->count() > 0)
    refuse_given(app, {"--runs"}, "has nothing to add: --ss-flow and --slat-flow name both runs");
  if (arguments.sampling.structure_guidance == 1.0)
    refuse_given(app, {"--ss-interval"}, "--ss-guidance 1 guides at no time");
  if (arguments.sampling.latent_guidance == 1.0)
    refuse_given(app, {"--slat-interval"}, "--slat-guidance 1 guides at no time");
  if (arguments.sampling.structure_guidance == 1.0 && arguments.sampling.latent_guidance == 1.0)
    refuse_given(app, {"--guidance-every"}, "--ss-guidance 1 and --slat-guidance 1 guide at no time");
  if (arguments.keep_hidden) refuse_given(app, {"--hidden-views"}, "--keep-hidden looks for no hidden faces");
  for (const auto& [interval, option] :
       {std::pair(arguments.structure_interval, "--ss-interval"), {arguments.latent_interval, "--slat-interval"}}) {
    if (interval.size() == 2 && interval[0] > interval[1])
      throw InputError("", option, "the lower end of an interval comes first");
  }
  constexpr int kLeastTexture = 64;
  if (arguments.finishing.texture_size > 0 && arguments.finishing.texture_size < kLeastTexture)
    throw InputError("", "--texture-size", "is 0, for colours of vertices, or at least 64");
  if (arguments.no_smoothing)
    refuse_given(app, {"--smooth-iterations", "--smooth-alpha"}, "--no-smooth-skin leaves the weights as they are");
}

}  // namespace

int main(int argc, char** argv) {
  Program program(
      "anigen-generate", "Makes a rigged GLB of an image, or of several views: mesh, skeleton and skin weights.",
      "  anigen-generate frog.png -o frog.glb                 by the weights that ship, or those of $ANIGEN_WEIGHTS\n"
      "  anigen-generate frog.png -o results                  with previews and a record of how it was made\n"
      "  anigen-generate front.png side.png back.png --one-object -o results\n"
      "  anigen-generate frog.png --ss-flow runs/ss_flow --slat-flow runs/slat_flow -o results\n"
      "  anigen-generate -i photos/ --runs ckpts/ --ss-flow ckpts/anigen/ss_flow_duet --normals estimator \\\n"
      "    --normal-weights ckpts/dsine/dsine.pt --precision bf16 --low-memory -o results");
  program.first = "--image";
  GenerateArguments arguments;
  add_model_options(program.app, arguments);
  add_picture_options(program.app, arguments);
  add_sampling_options(program.app, arguments);
  add_finishing_options(program.app, arguments);
  program.add_common({"--keep-going", "--seed [42]", "--threads", "--device", "--json"}, library_versions());
  program.check = [&] {
    refuse_other_formats(arguments.output);
    refuse_ignored(program.app, arguments);
  };
  return program.run(argc, argv, [&] { torch_half("generation").generate(arguments, program.common); });
}
