#include <algorithm>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include "anigen/apps/common/command_line.h"
#include "anigen/apps/common/torch_half.h"
#include "anigen/core/config.h"
#include "anigen/core/error.h"
#include "anigen/core/parallel.h"
#include "anigen/io/rigs/rig_listing.h"
#include "anigen/prepare/dataset.h"
#include "anigen/prepare/workers.h"

namespace {

anigen::prepare::FeatureExtractorFactory feature_factory() {
  return [](const anigen::prepare::FeatureOptions& options) {
    return anigen::torch_half("--features").feature_extractor(options);
  };
}

/// Arguments of the command line, before they become prepare::PrepareOptions.
struct Arguments {
  anigen::prepare::PrepareOptions options;
  std::vector<std::string> inputs, cleaning_changes;
  std::string cleaning = "none", near_skeletons = "flag", shard, test_split;
  std::size_t procedural = 0, memory_mb = 0;
  std::string condition_cameras = "around";
  bool skip_assets = false, random_poses = false, view_geometry = false, strict = false;
};

void add_source_options(CLI::App& app, Arguments& a) {
  app.add_option("--out", a.options.out, "Folder of the dataset")->required();
  app.add_option("--input", a.inputs,
                 "Folders or files: .glb .gltf .fbx .dae, obj with rig text, Articulation-XL or rig .npz, Anymate .pt, "
                 "published datasets");
  app.add_option("--procedural", a.procedural, "Number of procedural creatures")
      ->check(anigen::whole_number(0, 10'000'000));
  app.add_option("--clean", a.cleaning, "Cleaning rules: none, anymate or articulation-xl")->capture_default_str();
  app.add_option("--clean-set", a.cleaning_changes, "Changes one rule, such as joints=[3,200] (datasets/README.md)");
}

void add_table_options(CLI::App& app, Arguments& a) {
  anigen::prepare::SplitOptions& split = a.options.tables.split;
  anigen::prepare::QualityLimits& limits = a.options.tables.limits;
  CLI::Option* fraction =
      app.add_option("--test-fraction", split.test_fraction,
                     "Part of the usable real assets kept for testing [0.333, or what the sources say themselves]")
          ->check(anigen::number(0, 1));
  CLI::Option* count = app.add_option("--test-count", split.test_count, "Number of usable real assets kept for testing")
                           ->check(anigen::whole_number(0))
                           ->excludes(fraction);
  CLI::Option* creatures =
      app.add_option("--procedural-test", split.procedural_test, "Number of usable creatures kept for testing")
          ->check(anigen::whole_number(0))
          ->capture_default_str();
  app.add_option(
         "--test-split", a.test_split,
         "File with the names of all test assets, one a line: uuid, sha256, path below the input, or SHARD#UUID")
      ->check(CLI::ExistingFile)
      ->type_name("FILE")
      ->excludes(fraction)
      ->excludes(count)
      ->excludes(creatures);
  app.add_option("--min-joints", limits.min_joints, "Fewer joints make is_bad_skeleton")
      ->check(anigen::whole_number(0))
      ->capture_default_str();
  app.add_option("--max-joints", limits.max_joints, "More joints make is_bad_skeleton")
      ->check(anigen::whole_number(1))
      ->capture_default_str();
  app.add_option("--same-bone", limits.same_bone,
                 "Bones that differ by no more than this make is_bad_skeleton; 0 compares exactly")
      ->check(anigen::number(0, 1))
      ->capture_default_str();
  app.add_option("--max-outside", limits.max_outside_share,
                 "A larger part of joints outside the mesh's box makes is_bad_skeleton")
      ->check(anigen::number(0, 1))
      ->capture_default_str();
  app.add_option("--max-invented-rows", limits.max_invented_rows,
                 "A larger part of vertices without weights in the file makes is_bad_skin")
      ->check(anigen::number(0, 1))
      ->capture_default_str();
  app.add_option("--least-weight-sum", limits.least_weight_sum, "A vertex with a lower sum makes is_bad_skin")
      ->check(anigen::number(0, 1))
      ->capture_default_str();
  app.add_option("--near-skeletons", a.near_skeletons, "Skeletons nearly equal to an earlier one: ignore, flag or drop")
      ->capture_default_str();
}

void add_step_options(CLI::App& app, Arguments& a) {
  anigen::prepare::StepPlan& plan = a.options.plan;
  app.add_option("--steps", plan.steps,
                 "Only these: import, asset, augment, skeleton, voxels, views, cond_views, features [import, asset, "
                 "skeleton, voxels, and those with a number or a model below]")
      ->delimiter(',');
  app.add_flag("--no-assets", a.skip_assets, "Do not keep the assets themselves (assets/<id>.glb)");
  app.add_option("--augment", plan.variants, "Posed variants of every asset")
      ->check(anigen::whole_number(0, 10'000))
      ->capture_default_str();
  app.add_flag("--random-poses", a.random_poses, "Do not take poses from the assets' own animations");
  app.add_option("--pose-probability", plan.poses.probability, "Of each joint to be turned in a random pose")
      ->check(anigen::number(0, 1))
      ->capture_default_str();
  app.add_option("--pose-angle", plan.poses.max_angle, "Largest angle of a random pose, degrees")
      ->check(anigen::number(0, 180))
      ->capture_default_str();
  app.add_option("--resolution", plan.resolution, "Of the voxel grid")
      ->check(anigen::whole_number(2, 1024))
      ->capture_default_str();
  app.add_option("--views", plan.views.count, "Pictures for features (published: 150)")
      ->check(anigen::whole_number(0, 1000));
  app.add_option("--view-size", plan.views.size, "Their side in pixels")
      ->check(anigen::whole_number(8, 4096))
      ->capture_default_str();
  app.add_option("--cond-views", plan.condition_views.count, "Pictures for image conditions (published: 24)")
      ->check(anigen::whole_number(0, 1000));
  app.add_option("--cond-view-size", plan.condition_views.size, "Their side in pixels")
      ->check(anigen::whole_number(8, 4096))
      ->capture_default_str();
  app.add_option("--cond-cameras", a.condition_cameras,
                 "around: from all sides, as published; front: from where people take pictures")
      ->capture_default_str()
      ->check(CLI::IsMember({"around", "front"}));
  app.add_option("--view-samples", plan.views.samples_per_axis, "Anti-aliasing: this many squared rays per pixel")
      ->check(anigen::whole_number(1, 16))
      ->capture_default_str();
  app.add_flag("--view-geometry", a.view_geometry, "Also write normals and depth of the pictures");
  app.add_option("--features", plan.features.model, "surface, or a DINOv2 model such as dinov2_vitl14_reg");
  app.add_option("--feature-weights", plan.features.weights, "Weights of the DINOv2 model (.pth or .safetensors)");
}

void add_run_options(CLI::App& app, Arguments& a) {
  anigen::prepare::RunOptions& run = a.options.run;
  run.timeout = 1800;
  app.add_option("--workers", run.workers, "Worker processes [as many as --threads]")
      ->check(anigen::whole_number(0, 1024));
  app.add_option("--timeout", run.timeout, "Seconds for one asset, after which it counts as failed; 0: no limit")
      ->check(anigen::number(0, 1e9))
      ->capture_default_str();
  app.add_option("--memory-mb", a.memory_mb,
                 "Memory of one worker, above which its asset counts as failed; 0: no limit")
      ->check(anigen::whole_number(0, 1'000'000'000))
      ->capture_default_str();
  app.add_option("--shard", a.shard, "Only part i of n as i/n, counted from 0; not needed for several to work at once");
  app.add_flag("--retry-failed", run.retry_failed, "Try again what failed before");
  app.add_flag("--strict", a.strict, "Exit with 1 when anything failed or was rejected");
}

/// Options of what is not made, which would be ignored.
void refuse_ignored(const CLI::App& app, const Arguments& a) {
  const anigen::prepare::StepPlan& plan = a.options.plan;
  const bool condition_views = plan.wants("cond_views"), features = plan.wants("features");
  // Features of a network are made of views, which are made for them where they are not there.
  const bool views = plan.wants("views") || (features && plan.features.model != "surface");
  if (!views && plan.views.count > 0) anigen::refuse_given(app, {"--views"}, "--steps leaves views out");
  if (!condition_views && plan.condition_views.count > 0)
    anigen::refuse_given(app, {"--cond-views"}, "--steps leaves cond_views out");
  // A number of 0 says that none are wanted, as a variant of an experiment does that keeps the other options.
  const bool no_views = !views && app.get_option("--views")->count() == 0;
  const bool no_condition_views = !condition_views && app.get_option("--cond-views")->count() == 0;
  if (no_views) anigen::refuse_given(app, {"--view-size"}, "is of the pictures of --views, and none are made");
  if (no_condition_views) {
    anigen::refuse_given(app, {"--cond-view-size", "--cond-cameras"},
                         "is of the pictures of --cond-views, and none are made");
  }
  if (no_views && no_condition_views) {
    anigen::refuse_given(app, {"--view-samples", "--view-geometry"},
                         "is of the pictures of --views and --cond-views, and none are made");
  }
  if (!features && !plan.features.model.empty())
    anigen::refuse_given(app, {"--features"}, "--steps leaves features out");
  if (!features || plan.features.model == "surface") {
    anigen::refuse_given(app, {"--feature-weights", "--device"},
                         "is of the network of --features dinov2_…, and none is used");
  }
  if (!plan.wants("voxels") && !features)
    anigen::refuse_given(app, {"--resolution"}, "is of voxels, and --steps leaves them out");
  if (plan.variants == 0 && app.get_option("--augment")->count() == 0) {
    anigen::refuse_given(app, {"--random-poses", "--pose-probability", "--pose-angle"},
                         "is of the variants of --augment, and none are made");
  }
  if (!plan.steps.empty()) anigen::refuse_given(app, {"--no-assets"}, "--steps says already what is made");
}

anigen::prepare::CleaningOptions cleaning_options(const Arguments& a) {
  anigen::Json json = anigen::prepare::cleaning_preset(a.cleaning).to_json();
  anigen::apply_overrides(json, a.cleaning_changes);
  return anigen::prepare::CleaningOptions::from_json(json);
}

anigen::prepare::PrepareOptions complete(Arguments& a, const anigen::CommonOptions& common) {
  using namespace anigen::prepare;
  PrepareOptions options = a.options;
  options.plan.keep_assets = !a.skip_assets;
  options.plan.seed = options.tables.split.seed = common.seed;
  options.plan.features.device = common.device;
  options.plan.poses.own_motion = !a.random_poses;
  options.plan.cleaning = cleaning_options(a);
  options.plan.condition_views.samples_per_axis = options.plan.views.samples_per_axis;
  options.plan.condition_views.front = a.condition_cameras == "front";
  options.plan.views.geometry = options.plan.condition_views.geometry = a.view_geometry;
  options.tables.near_skeletons = parse_near_skeletons(a.near_skeletons);
  options.run.memory_bytes = std::uint64_t{a.memory_mb} << 20;
  options.run.shard = a.shard.empty() ? Shard{} : parse_shard(a.shard);
  options.run.log_level = common.quiet ? "error" : "warn";
  options.run.worker_command = {std::filesystem::read_symlink("/proc/self/exe").string(), "--worker"};
  if (!a.test_split.empty()) {
    for (const anigen::io::SplitLine& line : anigen::io::read_split(a.test_split))
      options.tables.split.test_names.push_back(line.id);
  }
  options.plan.validate();  // before hours of listing
  options.sources = find_assets({a.inputs.begin(), a.inputs.end()});
  for (auto& source : procedural_sources(common.seed, a.procedural)) options.sources.push_back(std::move(source));
  // Articulation-XL shards are read whole by every worker; on a GPU every worker keeps a model there.
  constexpr std::size_t kHeavyWorkers = 2;
  const bool whole_shards = std::any_of(options.sources.begin(), options.sources.end(), [](const AssetSource& source) {
    return !source.procedural() && source.format == anigen::io::RigFormat::kArticulationXl;
  });
  const bool gpu_models = common.device != "cpu" && !options.plan.features.model.empty();
  if (options.run.workers == 0 && (whole_shards || gpu_models)) {
    options.run.workers = std::min<std::size_t>(kHeavyWorkers, static_cast<std::size_t>(anigen::thread_count()));
  }
  return options;
}

void show(const anigen::prepare::PrepareSummary& summary, const anigen::CommonOptions& common) {
  if (common.json) {
    std::printf("%s\n", to_json(summary).dump(2).c_str());
  } else if (!common.quiet) {
    std::fputs(to_text(summary).c_str(), stdout);
  }
}

int merge(int argc, char** argv) {
  CLI::App app{
      "Checks that every asset is complete, and makes tables, splits and card of a dataset whose shards have finished.",
      "anigen-prepare merge"};
  anigen::CommonOptions common;
  std::filesystem::path out;
  app.add_option("--out", out, "Folder of the dataset")->required();
  anigen::add_common_options(app, common, {}, {{"--seed", "draws nothing at random"}, {"--device", "uses the CPU"}});
  return anigen::run_command(app, common, argc, argv, [&] { show(anigen::prepare::merge_dataset(out), common); });
}

}  // namespace

int main(int argc, char** argv) {
  using namespace anigen;
  // Command by which this program starts itself; everything else comes through its standard input.
  if (argc == 2 && std::strcmp(argv[1], "--worker") == 0) return prepare::run_worker(feature_factory());
  if (argc >= 2 && std::strcmp(argv[1], "merge") == 0) return merge(argc - 1, argv + 1);
  CLI::App app{
      "Turns rigged files, published datasets and procedural creatures into a dataset on disk.\n"
      "Repeating a command goes on where it stopped: what exists already is not made again. The same command may be "
      "at\n"
      "work several times, on one machine or on many that share the folder: they divide the work (docs/cluster.md).\n\n"
      "Examples:\n"
      "  anigen-prepare --out data/creatures --procedural 400\n"
      "  anigen-prepare --out data/mixed --input models/ more_models/ --procedural 400 --test-fraction 0.333\n"
      "  anigen-prepare --out data/all --input models/ --augment 4 --views 24 --cond-views 8 --features surface\n"
      "  anigen-prepare --out data/xl --input articulation_xl.npz --test-count 1000 --shard 3/16\n"
      "  anigen-prepare --out data/xl --input articulation_xl.npz --test-split test_uuids.txt\n"
      "  anigen-prepare merge --out data/xl"};
  CommonOptions common;
  Arguments arguments;
  arguments.options.plan.condition_views.size = 1024;
  add_source_options(app, arguments);
  add_step_options(app, arguments);
  add_table_options(app, arguments);
  add_run_options(app, arguments);
  add_common_options(app, common, library_versions());
  return run_command(app, common, argc, argv, [&] {
    refuse_ignored(app, arguments);
    const prepare::PrepareSummary summary = prepare::prepare_dataset(complete(arguments, common));
    show(summary, common);
    if (arguments.strict && (!summary.rejected.empty() || summary.failed_steps > 0)) {
      throw Error("some sources failed, which --strict does not allow");
    }
  });
}
