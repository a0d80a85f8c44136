#include <algorithm>
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
#include "anigen/engine/prepare_request.h"
#include "anigen/io/rigs/rig_listing.h"
#include "anigen/prepare/export_shard.h"
#include "anigen/prepare/workers.h"

namespace {

using namespace anigen;

prepare::FeatureExtractorFactory feature_factory() {
  return [](const prepare::FeatureOptions& options) { return torch_half("--features").feature_extractor(options); };
}

/// Arguments of the command line, before they become a request.
struct Arguments {
  engine::PrepareOptions dataset;
  prepare::PrepareOptions request;  ///< what the library has no option for
  std::vector<std::string> inputs, cleaning_changes;
  std::string near_skeletons, split_by = "asset", shard, test_split, condition_cameras = "around";
  std::size_t memory_mb = 0, stream = 0, shards = 4, stop_after = 0;
  std::string encode_ss, encode_slat;
  bool random_poses = false, strict = false;
};

void add_source_options(CLI::App& app, Arguments& a) {
  add_option(app, "--output", a.request.out, ": folder of the dataset");
  add_option(app, "--input", a.inputs);
  add_option(app, "--procedural", a.dataset.creatures)->check(whole_number(0, 10'000'000));
  add_option(app, "--stream", a.stream)->check(whole_number(1, 1'000'000))->default_str("");
}

void add_table_options(CLI::App& app, Arguments& a) {
  prepare::SplitOptions& split = a.request.tables.split;
  prepare::QualityLimits& limits = a.request.tables.limits;
  add_option(app, "--clean", a.dataset.cleaning);
  add_option(app, "--clean-set", a.cleaning_changes);
  CLI::Option* fraction = add_option(app, "--test-fraction", a.dataset.test_fraction)->check(number(0, 1));
  CLI::Option* count = add_option(app, "--test-count", split.test_count)->check(whole_number(0))->excludes(fraction);
  CLI::Option* unit = add_option(app, "--split-by", a.split_by)->check(one_of({"asset", "skeleton"}));
  CLI::Option* creatures = add_option(app, "--procedural-test", split.procedural_test)->check(whole_number(0));
  add_option(app, "--test-split", a.test_split)
      ->excludes(fraction)
      ->excludes(count)
      ->excludes(creatures)
      ->excludes(unit);
  add_option(app, "--min-joints", limits.min_joints)->check(whole_number(0));
  add_option(app, "--max-joints", limits.max_joints)->check(whole_number(1));
  add_option(app, "--same-bone", limits.same_bone)->check(number(0, 1));
  add_option(app, "--max-outside", limits.max_outside_share)->check(number(0, 1));
  add_option(app, "--max-invented-rows", limits.max_invented_rows)->check(number(0, 1));
  add_option(app, "--least-weight-sum", limits.least_weight_sum)->check(number(0, 1));
  add_option(app, "--near-skeletons", a.near_skeletons);
}

void add_step_options(CLI::App& app, Arguments& a) {
  prepare::StepPlan& plan = a.request.plan;
  add_option(app, "--only", plan.steps,
             ": of import, asset, augment, skeleton, voxels, views, cond_views, features [import, asset, skeleton, "
             "voxels, and those with a number or a model below]")
      ->delimiter(',');
  add_switch_off(app, "--no-assets", a.dataset.keep_assets);
  add_option(app, "--augment", a.dataset.poses)->check(whole_number(0, 10'000));
  CLI::Option* random_poses = add_option(app, "--random-poses", a.random_poses);
  add_option(app, "--key-frames", plan.poses.key_frames)->excludes(random_poses);
  add_option(app, "--pose-probability", plan.poses.probability)->check(number(0, 1));
  add_option(app, "--pose-angle", plan.poses.max_angle)->check(number(0, 180));
  add_option(app, "--pose-scale", plan.poses.anisotropic_scale)->check(number(0, 1));
  add_option(app, "--voxel-resolution", a.dataset.resolution)->check(whole_number(2, 1024));
  add_option(app, "--views", a.dataset.views)->check(whole_number(0, 1000));
  add_option(app, "--view-size", a.dataset.view_size)->check(whole_number(8, 4096));
  add_option(app, "--cond-views", a.dataset.condition_views)->check(whole_number(0, 1000));
  add_option(app, "--cond-view-size", a.dataset.condition_view_size)->check(whole_number(8, 4096));
  add_option(app, "--cond-cameras", a.condition_cameras);
  add_option(app, "--view-samples", plan.views.samples_per_axis)->check(whole_number(1, 16));
  add_option(app, "--view-geometry", a.dataset.view_geometry);
  add_option(app, "--features", a.dataset.features);
  add_option(app, "--feature-weights", a.dataset.feature_weights);
  add_option(app, "--encode-ss", a.encode_ss);
  add_option(app, "--encode-slat", a.encode_slat);
}

void add_run_options(CLI::App& app, Arguments& a) {
  prepare::RunOptions& run = a.request.run;
  run.timeout = 1800;
  add_option(app, "--workers", run.workers, " [as many as --threads]")->check(whole_number(0, 1024))->default_str("");
  add_option(app, "--asset-timeout", run.timeout)->check(number(0, 1e9));
  add_option(app, "--memory-mb", a.memory_mb)->check(whole_number(0, 1'000'000'000));
  add_option(app, "--shard", a.shard);
  add_option(app, "--shards", a.shards)->check(whole_number(1, 10'000));
  add_option(app, "--stop-after", a.stop_after)->check(whole_number(0));
  add_option(app, "--retry-failed", run.retry_failed);
  add_option(app, "--strict", a.strict);
}

/// Options of what is not made, which would be ignored. @param plan of the request
void refuse_ignored(const CLI::App& app, const Arguments& a, const prepare::StepPlan& plan) {
  if (a.stream == 0) {
    refuse_given(app, {"--shards", "--stop-after", "--encode-ss", "--encode-slat"}, "applies only with --stream");
  } else {
    refuse_given(app, {"--input", "--procedural", "--shard", "--strict"}, "does not go with --stream");
    refuse_given(app, {"--test-fraction", "--test-count", "--split-by", "--procedural-test", "--test-split"},
                 "does not go with --stream, whose creatures are all for training");
  }
  const bool condition_views = plan.wants("cond_views"), features = plan.wants("features");
  // Features of a network are made of views, which are made for them where they are not there.
  const bool views = plan.wants("views") || (features && plan.features.model != "surface");
  if (!views && plan.views.count > 0) refuse_given(app, {"--views"}, "--only leaves views out");
  if (!condition_views && plan.condition_views.count > 0)
    refuse_given(app, {"--cond-views"}, "--only leaves cond_views out");
  // A number of 0 says that none are wanted, as a variant of an experiment does that keeps the other options.
  const bool no_views = !views && app.get_option("--views")->count() == 0;
  const bool no_condition_views = !condition_views && app.get_option("--cond-views")->count() == 0;
  if (no_views) refuse_given(app, {"--view-size"}, "has no effect: no images of --views are made");
  if (no_condition_views) {
    refuse_given(app, {"--cond-view-size", "--cond-cameras"}, "has no effect: no images of --cond-views are made");
  }
  if (no_views && no_condition_views) {
    refuse_given(app, {"--view-samples", "--view-geometry"},
                 "has no effect: no images of --views or --cond-views are made");
  }
  if (!features && !plan.features.model.empty()) refuse_given(app, {"--features"}, "--only leaves features out");
  if (!features || plan.features.model == "surface") {
    refuse_given(app, {"--feature-weights", "--device"}, "applies only to the network of --features dinov2_…");
  }
  if (!plan.wants("voxels") && !features)
    refuse_given(app, {"--voxel-resolution"}, "applies to voxels, and --only leaves them out");
  if (plan.variants == 0 && app.get_option("--augment")->count() == 0) {
    refuse_given(app, {"--random-poses", "--key-frames", "--pose-probability", "--pose-angle", "--pose-scale"},
                 "has no effect without --augment");
  }
  if (plan.poses.key_frames)
    refuse_given(app, {"--pose-probability", "--pose-angle"}, "applies to random poses, and --key-frames makes none");
  if (!plan.steps.empty()) refuse_given(app, {"--no-assets"}, "--only says already what is made");
}

prepare::CleaningOptions changed(const prepare::CleaningOptions& cleaning, const std::vector<std::string>& changes) {
  Json json = cleaning.to_json();
  apply_overrides(json, changes);
  return prepare::CleaningOptions::from_json(json);
}

/// Sets what the library has no option for. @param request as engine::dataset_request() gives it
void complete(const Arguments& a, const CommonOptions& common, prepare::PrepareOptions& request) {
  request.plan.features.device = common.device;
  request.plan.poses.own_motion = !a.random_poses;
  request.plan.cleaning = changed(request.plan.cleaning, a.cleaning_changes);
  request.plan.condition_views.samples_per_axis = request.plan.views.samples_per_axis;
  request.tables.split.by_skeleton = a.split_by == "skeleton";
  if (!a.near_skeletons.empty()) request.tables.near_skeletons = prepare::parse_near_skeletons(a.near_skeletons);
  request.run.memory_bytes = std::uint64_t{a.memory_mb} << 20;
  request.run.shard = a.shard.empty() ? prepare::Shard{} : prepare::parse_shard(a.shard);
  request.run.log_level = common.quiet ? "error" : "warn";
  request.run.worker_command = {std::filesystem::read_symlink("/proc/self/exe").string(), "--worker"};
  if (a.test_split.empty()) return;
  for (const io::SplitLine& line : io::read_split(a.test_split)) request.tables.split.test_names.push_back(line.id);
}

prepare::PrepareSummary make_dataset(const Arguments& a, const CommonOptions& common,
                                     prepare::PrepareOptions& request) {
  engine::add_sources({a.inputs.begin(), a.inputs.end()}, a.dataset, request);
  // Articulation-XL shards are read whole by every worker; on a GPU every worker keeps a model there.
  constexpr std::size_t kHeavyWorkers = 2;
  const auto is_whole_shard = [](const prepare::AssetSource& source) {
    return !source.procedural() && source.format == io::RigFormat::kArticulationXl;
  };
  const bool whole_shards = std::any_of(request.sources.begin(), request.sources.end(), is_whole_shard);
  const bool gpu_models = common.device != "cpu" && !request.plan.features.model.empty();
  if (request.run.workers == 0 && (whole_shards || gpu_models))
    request.run.workers = std::min<std::size_t>(kHeavyWorkers, static_cast<std::size_t>(thread_count()));
  return prepare::prepare_dataset(request);
}

prepare::StreamOptions stream_options(const Arguments& a, const CommonOptions& common,
                                      const prepare::PrepareOptions& request) {
  request.plan.validate();
  prepare::StreamOptions stream;
  stream.shard = request;
  stream.seed = a.dataset.seed;
  stream.creatures = a.stream;
  stream.shards = a.shards;
  stream.end = a.stop_after;
  const std::filesystem::path encode = std::filesystem::read_symlink("/proc/self/exe").parent_path() / "anigen-encode";
  for (const auto& [what, run] : {std::pair{"ss", a.encode_ss}, {"slat", a.encode_slat}}) {
    if (run.empty()) continue;
    stream.encoders[what] = run;
    stream.commands.push_back({encode.string(), what, "--run", run, "--quiet", "--device", common.device, "--threads",
                               std::to_string(thread_count()), "--dataset"});
  }
  return stream;
}

}  // namespace

int main(int argc, char** argv) {
  // Command by which this program starts itself; everything else comes through its standard input.
  if (argc == 2 && std::strcmp(argv[1], "--worker") == 0) return prepare::run_worker(feature_factory());
  Program program(
      "anigen-prepare",
      "Turns rigged files, published datasets and procedural creatures into a dataset on disk.\n"
      "Repeating a command goes on where it stopped: what exists already is not made again. The same command may be "
      "at\n"
      "work several times, on one machine or on many that share the folder: they divide the work (docs/cluster.md).",
      "  anigen-prepare -o data/creatures --procedural 400\n"
      "  anigen-prepare -o data/mixed --input models/ more_models/ --procedural 400 --test-fraction 0.333\n"
      "  anigen-prepare -o data/all --input models/ --augment 4 --views 24 --cond-views 8 --features surface\n"
      "  anigen-prepare -o data/xl --input articulation_xl.npz --test-count 1000 --shard 3/16\n"
      "  anigen-prepare -o data/xl --input articulation_xl.npz --test-split test_uuids.txt\n"
      "  anigen-prepare -o data/stream --stream 500 --shards 8 --no-assets\n"
      "  anigen-prepare merge -d data/xl\n"
      "  anigen-prepare export -d data/xl --split data/xl/splits/test.txt -o mine_test.npz");
  CLI::App& app = program.app;
  Arguments arguments;
  std::filesystem::path merged;
  CLI::App& merge = program.command("merge",
                                    "Checks that every asset of a dataset whose shards have finished is complete, and "
                                    "makes its tables, splits and card");
  add_option(merge, "--dataset", merged)->required();
  prepare::ExportRequest exported;
  std::vector<std::string> exported_splits;
  CLI::App& exporting = program.command("export",
                                        "Writes the rigs of a dataset, a folder or a shard into one file with many: "
                                        ".npz as Articulation-XL 2.0 has them, .pt as Anymate");
  add_option(exporting, "--dataset", exported.source)->required();
  add_option(exporting, "--split", exported_splits);
  add_option(exporting, "--limit", exported.most)->check(whole_number(0));
  add_option(exporting, "--output", exported.out, "; .npz or .pt")->required();
  add_source_options(app, arguments);
  add_step_options(app, arguments);
  add_table_options(app, arguments);
  add_run_options(app, arguments);
  const std::size_t own_options = app.get_options().size();
  program.add_common({"--keep-going", "--seed [0]", "--threads", "--device", "--json"}, library_versions());
  prepare::PrepareOptions request;
  program.check = [&] {
    for (std::size_t i = 0; i < own_options && merge.parsed(); ++i)
      refuse_given(app, {app.get_options()[i]->get_name()}, "has no meaning for merge, which takes --dataset alone");
    for (std::size_t i = 0; i < own_options && exporting.parsed(); ++i)
      refuse_given(app, {app.get_options()[i]->get_name()}, "has no meaning for export, whose options follow it");
    if (merge.parsed()) return refuse_given(app, {"--keep-going", "--seed", "--device"}, "has no meaning for merge");
    if (exporting.parsed()) return refuse_given(app, {"--seed", "--device"}, "has no meaning for export");
    if (arguments.request.out.empty()) throw InputError("", "--output", "name the folder to write the dataset to");
    arguments.dataset.seed = program.common.seed.value_or(arguments.dataset.seed);
    arguments.dataset.front_cameras = arguments.condition_cameras == "front";
    request = engine::dataset_request(arguments.dataset, arguments.request);
    refuse_ignored(app, arguments, request.plan);
  };
  return program.run(argc, argv, [&] {
    if (merge.parsed()) {
      const prepare::PrepareSummary summary = prepare::merge_dataset(merged);
      return print_result(to_json(summary), to_text(summary), program.common);
    }
    if (exporting.parsed()) {
      exported.splits = {exported_splits.begin(), exported_splits.end()};
      exported.keep_going = program.common.keep_going;
      const prepare::ExportSummary summary = prepare::export_shard(exported);
      return print_result({{"written", summary.written}, {"left_out", summary.left_out}},
                          std::to_string(summary.written) + " rigs were written into " + exported.out.string() + "\n",
                          program.common);
    }
    complete(arguments, program.common, request);
    if (arguments.stream > 0) {
      const std::uint64_t made = prepare::stream_dataset(stream_options(arguments, program.common, request));
      return print_result({{"shards", made}}, std::to_string(made) + " shards were made\n", program.common);
    }
    const prepare::PrepareSummary summary = make_dataset(arguments, program.common, request);
    print_result(to_json(summary), to_text(summary), program.common);
    if (arguments.strict && !summary.rejected.empty())
      throw Error(std::to_string(summary.rejected.size()) + " sources were rejected, which --strict does not allow");
    if (summary.failed_steps > 0 && !program.common.keep_going)
      throw Error(std::to_string(summary.failed_steps) + " steps failed; --keep-going allows that");
  });
}
