#include <algorithm>
#include <utility>

#include "anigen/apps/common/command_line.h"
#include "anigen/apps/common/torch_half.h"
#include "anigen/apps/eval_arguments.h"
#include "anigen/core/error.h"
#include "anigen/core/log.h"
#include "anigen/core/parallel.h"
#include "anigen/engine/evaluate_request.h"
#include "anigen/eval/protocol.h"
#include "anigen/eval/skin_evaluation.h"

namespace {

using namespace anigen;

constexpr const char* kShapes = "; with --pred";
constexpr const char* kStructures = "; with --ss-flow";
constexpr const char* kOracle = "; with --oracle";
constexpr const char* kMatting = "; with --matting-network";

bool evaluates_weights(const EvalArguments& options) {
  return !options.skin_ae.empty() || !options.skins.empty() || !options.skin_runs.empty();
}

void evaluate_skins(const EvalArguments& options, const CommonOptions& common) {
  eval::SkinRequest request;
  request.dataset = options.dataset;
  request.splits = {options.splits.begin(), options.splits.end()};
  request.out = options.output;
  request.pictured = options.report_images;
  request.report = !options.no_report;
  if (!options.skin_ae.empty()) {
    request.run = options.skin_ae;
    request.settings["skin_ae"] = options.skin_ae;
    request.methods.push_back(torch_half("--skin-ae").skin_reconstruction(options.skin_ae, common, request.settings));
  }
  if (!options.skin_runs.empty()) {
    constexpr int kPoses = 10;
    request.methods = torch_half("--skin-run").skin_corrections(options.skin_runs, common, request.settings);
    request.poses = kPoses;
    if (options.skin_runs.size() == 1) request.run = options.skin_runs.front();
  }
  request.skins = options.skins;
  const eval::SkinEvaluation evaluation = eval::run_skin_evaluation(request);
  print_result(to_json(evaluation), to_markdown(evaluation), common);
  eval::require_scores(evaluation, options.output);
  const auto failed = std::count_if(evaluation.assets.begin(), evaluation.assets.end(),
                                    [](const auto& asset) { return !asset.methods.front().failure.empty(); });
  require_inputs(static_cast<std::size_t>(failed), evaluation.assets.size(),
                 "assets could not be scored (" + options.output + "/metrics.csv says why)", common);
}

eval::EvaluationRequest shapes_request(const EvalArguments& options, const CommonOptions& common) {
  eval::EvaluationRequest request = options.shapes;
  request.truth = options.dataset;
  request.splits = {options.splits.begin(), options.splits.end()};
  request.most = options.limit;
  request.out = options.output;
  eval::set_prediction_axes(options.prediction_up, request);
  request.truth_axes = io::parse_axes(options.dataset_up);
  if (!options.lpips_weights.empty() || !options.image_encoder.empty()) {
    torch_half(options.lpips_weights.empty() ? "--image-encoder" : "--lpips-weights")
        .add_perceptual_distances(options, common, request);
  }
  request.settings.transport = eval::parse_transport(options.transport);
  if (options.point_to_plane) request.settings.alignment.registration.variant = metrics::IcpVariant::kPointToPlane;
  engine::EvaluateOptions scores = options.scores;
  scores.seed = common.seed.value_or(scores.seed);
  request.settings = engine::pair_settings(scores, request.settings);
  request.protocol = scores.protocol;
  request.resume = !options.force;
  request.report = !options.no_report;
  request.pictured = options.report_images;
  return request;
}

void evaluate_shapes(const EvalArguments& options, const CommonOptions& common) {
  const eval::Comparison comparison = eval::run_evaluation(shapes_request(options, common));
  std::string text = to_markdown(comparison);
  if (!options.scores.protocol.empty())
    text += "\n" + protocol_markdown(comparison, eval::evaluation_protocol(options.scores.protocol));
  print_result(eval::to_json(comparison), text, common);
  for (std::size_t m = 0; m < comparison.methods.size(); ++m) {
    require_inputs(
        eval::failures(comparison, m), comparison.ids.size(),
        "assets could not be evaluated for " + comparison.methods[m] + " (" + options.output + "/metrics.csv says why)",
        common);
  }
}

void evaluate_oracle(const EvalArguments& options, const CommonOptions& common) {
  eval::EvaluationRequest pairs = shapes_request(options, common);
  if (options.scores.groups.empty()) pairs.settings.groups = {"skeleton", "transport", "skin", "surface"};
  torch_half("--oracle").evaluate_oracle(options, common, pairs);
}

void run(const EvalArguments& options, const CommonOptions& common) {
  if (!options.matting_network.empty()) return torch_half("--matting-network").evaluate_matting(options, common);
  if (options.oracle) return evaluate_oracle(options, common);
  if (!options.ss_flow.empty()) return torch_half("--ss-flow").evaluate_structures(options, common);
  if (!options.shapes.predictions.empty()) return evaluate_shapes(options, common);
  evaluate_skins(options, common);
}

void refuse_beside_matting(const EvalArguments& options) {
  const std::pair<bool, const char*> others[] = {{options.oracle, "--oracle"},
                                                 {!options.ss_flow.empty(), "--ss-flow"},
                                                 {!options.shapes.predictions.empty(), "--pred"},
                                                 {!options.skin_ae.empty(), "--skin-ae"},
                                                 {!options.skins.empty(), "--skins"},
                                                 {!options.skin_runs.empty(), "--skin-run"}};
  for (const auto& [given, option] : others) {
    if (given) throw InputError("", option, "--matting-network evaluates outlines, and nothing else at the same time");
  }
  if (options.dataset.empty()) throw InputError("", "--dataset", "name the dataset that holds the objects");
}

void refuse_beside_oracle(const EvalArguments& options) {
  if (!options.shapes.predictions.empty() || evaluates_weights(options))
    throw InputError("", "--oracle", "makes its predictions itself, and evaluates nothing else at the same time");
  for (const auto& [value, option] : {std::pair(options.ss_flow, "--ss-flow"), {options.slat_flow, "--slat-flow"}})
    if (value.empty()) throw InputError("", option, "--oracle needs the runs of both flows");
  if (options.dataset.empty()) throw InputError("", "--dataset", "name the dataset that holds the true assets");
  if (options.guidance.size() > 1) throw InputError("", "--ss-guidance", "--oracle generates with one guidance scale");
}

/// A command evaluates one thing, and needs what that is compared with. @throws InputError
void refuse_two_tasks(const EvalArguments& options) {
  if (!options.matting_network.empty()) return refuse_beside_matting(options);
  if (options.oracle) return refuse_beside_oracle(options);
  const bool shapes = !options.shapes.predictions.empty();
  if (!options.shapes.category_splits.empty() && !shapes)
    throw InputError("", "--category-split", "sorts rigged shapes: it needs --pred");
  if (options.limit > 0 && options.ss_flow.empty() && (!shapes || options.dataset.empty()))
    throw InputError("", "--limit", "goes with --pred and --dataset, with --ss-flow or with --matting-network");
  if (!options.ss_flow.empty()) {
    if (shapes || evaluates_weights(options))
      throw InputError("", "--ss-flow", "evaluates a flow of sparse structures, and nothing else at the same time");
    return;
  }
  if (shapes) {
    if (evaluates_weights(options))
      throw InputError("", "--pred",
                       "compares rigged shapes; --skin-ae, --skin-run and --skins evaluate weights: one or the other");
    return;
  }
  if (!options.shapes.motion.empty() || options.shapes.motions_pictured > 0)
    throw InputError("", options.shapes.motion.empty() ? "--motion-images" : "--motion",
                     "moves rigged shapes: it needs --pred");
  if (!options.lpips_weights.empty() || !options.image_encoder.empty())
    throw InputError("", options.lpips_weights.empty() ? "--image-encoder" : "--lpips-weights",
                     "compares images of rigged shapes: it needs --pred");
  if (options.dataset.empty())
    throw InputError("", "--dataset", "name the ground truth: a file, a folder or a dataset");
  if (!options.skin_runs.empty() && !options.skin_ae.empty())
    throw InputError("", "--skin-run", "binds meshes, and --skin-ae gives back true weights: evaluate one at a time");
}

/// Options of rigged shapes alone. @return their names
std::vector<std::string> add_shape_options(CLI::App& app, EvalArguments& options) {
  auto& icp = options.shapes.settings.alignment.registration;
  std::vector<std::string> names;
  const auto add = [&](const char* name, auto& variable) {
    names.emplace_back(name);
    return add_option(app, name, variable, kShapes);
  };
  add("--pred-up", options.prediction_up);
  add("--dataset-up", options.dataset_up);
  add("--protocol", options.scores.protocol);
  add("--normalize", options.scores.normalization);
  names.emplace_back("--no-icp");
  add_switch_off(app, "--no-icp", options.scores.registration, kShapes);
  add("--visible-surface", options.scores.visible_surface);
  add("--merge-joints", options.scores.merge_joints)->check(number(0, 0.5));
  add("--rotations", icp.rotations)->check(whole_number(0, 100'000));
  add("--icp-scale", icp.similarity);
  add("--icp-plane", options.point_to_plane);
  add("--icp-trim", icp.trim)->check(number(0, 1, RangeEnds::kOpenBelow));
  add("--exhaustive", icp.exhaustive);
  add("--metrics", options.scores.groups)->delimiter(',');
  add("--transport", options.transport);
  add("--sinkhorn-epsilon", options.shapes.settings.epsilon)->check(number(0, 1, RangeEnds::kOpenBelow));
  add("--category-split", options.shapes.category_splits);
  add("--surface-samples", options.scores.surface_samples)->check(whole_number(1, 10'000'000));
  add("--image-size", options.shapes.settings.image_size)->check(whole_number(16, 4096));
  add("--lpips-weights", options.lpips_weights)->expected(1, 2);
  add("--image-encoder", options.image_encoder);
  add("--poses", options.shapes.settings.poses)->check(whole_number(1, 10'000));
  names.emplace_back("--motion");
  add_option(app, "--motion", options.shapes.motion,
             std::string(", that every ground truth is given, and its predictions with it. Without, the first clip of "
                         "the ground truth itself; without one, random poses") +
                 kShapes);
  add("--motion-frames", options.shapes.settings.motion_frames)->check(whole_number(1, 10'000));
  add("--motion-images", options.shapes.motions_pictured)->check(whole_number(0, 10'000));
  add("--worst-by", options.shapes.worst_by);
  CLI::Option* force = add("--force", options.force);
  add("--accept-other-code", options.shapes.accept_other_code)->excludes(force);
  return names;
}

/// Options of sparse structures alone. @return their names
std::vector<std::string> add_structure_options(CLI::App& app, EvalArguments& options) {
  add_option(app, "--ss-flow", options.ss_flow, ": generate voxels from images and compare them");
  std::vector<std::string> names;
  const auto add = [&](const char* name, auto& variable) {
    names.emplace_back(name);
    return add_option(app, name, variable, kStructures);
  };
  add("--ss-dae", options.ss_dae);
  add("--ss-guidance", options.guidance)->delimiter(',')->check(number(1, 1001));
  add("--ss-steps", options.steps)->check(whole_number(1, 100'000));
  add("--train-split", options.train_split);
  add("--retrieval-views", options.views)->check(whole_number(0, 1000));
  return names;
}

/// Options of matting alone. @return their names
std::vector<std::string> add_matting_options(CLI::App& app, EvalArguments& options) {
  add_option(app, "--matting-network", options.matting_network,
             ": cut objects out and compare with their true outlines");
  std::vector<std::string> names;
  const auto add = [&](const char* name, auto& variable) {
    names.emplace_back(name);
    return add_option(app, name, variable, kMatting);
  };
  add("--backgrounds", options.backgrounds);
  add("--matting-mean", options.matting_mean)->delimiter(',')->expected(3)->check(number(-1000, 1000));
  add("--matting-deviation", options.matting_deviation)
      ->delimiter(',')
      ->expected(3)
      ->check(number(0, 1000, RangeEnds::kOpenBelow));
  return names;
}

/// Options of the oracle alone. @return their names
std::vector<std::string> add_oracle_options(CLI::App& app, EvalArguments& options) {
  add_option(app, "--oracle", options.oracle);
  std::vector<std::string> names;
  const auto add = [&](const char* name, auto& variable) {
    names.emplace_back(name);
    return add_option(app, name, variable, kOracle);
  };
  add("--slat-flow", options.slat_flow);
  add("--slat-dae", options.slat_dae);
  add("--slat-guidance", options.slat_guidance)->check(number(1, 1001));
  add("--slat-steps", options.slat_steps)->check(whole_number(1, 100'000));
  add("--cluster-bandwidth", options.cluster_bandwidth)->check(number(0, 1, RangeEnds::kOpenBelow));
  add("--cluster-min-votes", options.cluster_min_votes)->check(whole_number(1, 1'000'000));
  add("--cluster-algorithm", options.cluster_algorithm);
  add("--hidden-views", options.hidden_views)->check(whole_number(1, 100'000));
  add("--texture-size", options.texture_size)->check(whole_number(0, 8192));
  return names;
}

/// Options of another evaluation than the one asked for, or that others leave without effect.
void refuse_ignored(const CLI::App& app, const EvalArguments& options, const std::vector<std::string>& of_shapes,
                    const std::vector<std::string>& of_structures, const std::vector<std::string>& of_oracle,
                    const std::vector<std::string>& of_matting) {
  const bool structures = !options.ss_flow.empty() && !options.oracle;
  const bool shapes = !options.shapes.predictions.empty() || options.oracle;
  const bool matting = !options.matting_network.empty();
  if (!matting) refuse_given(app, of_matting, "applies only with --matting-network");
  if (matting) {
    refuse_given(app, {"--keep-going", "--json", "--no-report", "--device"}, "--matting-network has no use for it");
    refuse_given(app, of_shapes, "applies only to rigged shapes: it needs --pred");
    refuse_given(app, of_structures, "applies only to sparse structures: it needs --ss-flow");
    refuse_given(app, of_oracle, "applies only to generated assets: it needs --oracle");
    return;
  }
  if (!structures && !options.oracle)
    refuse_given(app, of_structures, "applies only to sparse structures: it needs --ss-flow");
  if (!shapes) refuse_given(app, of_shapes, "applies only to rigged shapes: it needs --pred");
  if (!options.oracle) refuse_given(app, of_oracle, "applies only to generated assets: it needs --oracle");
  if (options.oracle) {
    refuse_given(
        app, {"--train-split", "--retrieval-views", "--pred-up", "--dataset-up", "--lpips-weights", "--image-encoder"},
        "--oracle has no use for it");
  }
  if (structures) {
    refuse_given(app, {"--keep-going"}, "--ss-flow ends with the first asset that fails");
    refuse_given(app, {"--json"}, "--ss-flow prints a table; metrics.json of --output has its numbers");
    refuse_given(app, {"--no-report"}, "--ss-flow writes no report");
  } else if (options.no_report) {
    refuse_given(app, {"--report-images"}, "--no-report draws none");
  }
  if (!structures && !shapes) refuse_given(app, {"--seed"}, "the evaluation of weights draws nothing at random");
  if (!structures && !options.oracle && options.skin_ae.empty() && options.lpips_weights.empty() &&
      options.image_encoder.empty()) {
    refuse_given(app, {"--device"},
                 "applies to networks, which only --ss-flow, --oracle, --skin-ae, --lpips-weights and --image-encoder "
                 "use; the rest "
                 "is for the CPU");
  }
  if (!options.scores.protocol.empty()) {
    refuse_given(app,
                 {"--normalize", "--no-icp", "--visible-surface", "--merge-joints", "--metrics", "--rotations",
                  "--icp-scale", "--icp-plane", "--icp-trim", "--exhaustive", "--transport", "--sinkhorn-epsilon"},
                 "is fixed by --protocol " + options.scores.protocol);
  }
  if (!options.scores.registration) {
    refuse_given(app, {"--rotations", "--icp-scale", "--icp-plane", "--icp-trim", "--exhaustive"},
                 "applies to the registration that --no-icp leaves out");
  }
  const auto wants = [&](const char* metrics) {
    const std::string group = metrics;
    if (options.scores.groups.empty() && options.oracle)
      return group != "image" && group != "motion" && group != "anymate";
    return options.scores.groups.empty() || std::find(options.scores.groups.begin(), options.scores.groups.end(),
                                                      metrics) != options.scores.groups.end();
  };
  if (!wants("image"))
    refuse_given(app, {"--image-size", "--lpips-weights", "--image-encoder"}, "--metrics leaves 'image' out");
  if (!wants("surface") && !wants("motion"))
    refuse_given(app, {"--surface-samples"}, "--metrics leaves 'surface' and 'motion' out");
  if (!wants("motion") && options.shapes.motions_pictured == 0)
    refuse_given(app, {"--motion", "--motion-frames"}, "--metrics leaves 'motion' out");
  if (!wants("skin")) refuse_given(app, {"--poses"}, "--metrics leaves 'skin' out");
}

}  // namespace

int main(int argc, char** argv) {
  keep_freed_memory();
  Program program(
      "anigen-eval",
      "Compares predicted rigged shapes, or predicted skin weights alone, with ground truth.\n"
      "Writes metrics.json, metrics.csv, table.md, table.tex and report.html. docs/metrics.md defines every number.",
      "  anigen-eval --pred generated/ -d rigs/ -o results\n"
      "  anigen-eval --pred ours=generated/ --pred unirig=other/ -d articulation_xlv2_test.npz --split test.txt -o "
      "results\n"
      "  anigen-eval --pred a=one/ --pred b=two/ -d rigs/ -o results --motion walk.bvh --motion-images 3\n"
      "  anigen-eval --pred pairs.csv -o results             (CSV with columns pred, gt and perhaps id)\n"
      "  anigen-eval --skin-ae runs/skin_ae -d data --split data/splits/test.txt -o results\n"
      "  anigen-eval --skin-run runs/skin_correction -d data --split data/splits/test.txt -o results\n"
      "  anigen-eval -d data -o results                      (skinning baselines only)\n"
      "  anigen-eval --ss-flow runs/ss_flow -d data --split splits/test.txt -o results   (voxels from images)\n"
      "  anigen-eval --matting-network runs/matting -d data --split data/splits/test.txt -o results   (outlines)\n"
      "  anigen-eval --oracle --ss-flow runs/ss_flow --slat-flow runs/slat_flow -d data --split splits/test.txt -o "
      "results");
  CLI::App& app = program.app;
  EvalArguments options;
  add_option(app, "--pred", options.shapes.predictions);
  add_option(app, "--dataset", options.dataset, " with the ground truth, or file or folder of it");
  add_option(app, "--split", options.splits);
  add_option(app, "--limit", options.limit, "; with --pred, --ss-flow, --matting-network or --oracle")
      ->check(whole_number(0));
  add_option(app, "--output", options.output, ": folder")->required();
  add_option(app, "--skin-ae", options.skin_ae);
  add_option(app, "--skin-run", options.skin_runs,
             "; repeatable: of runs that held out folds each real rig gets the one that has not seen its skeleton");
  add_option(app, "--skins", options.skins);
  add_option(app, "--report-images", options.report_images)->check(whole_number(0, 100'000));
  add_option(app, "--no-report", options.no_report);
  const std::vector<std::string> shapes = add_shape_options(app, options);
  const std::vector<std::string> structures = add_structure_options(app, options);
  const std::vector<std::string> oracle = add_oracle_options(app, options);
  const std::vector<std::string> matting = add_matting_options(app, options);
  program.add_common({"--keep-going", "--seed [0]", "--threads", "--device", "--json"}, library_versions());
  program.check = [&] {
    refuse_ignored(app, options, shapes, structures, oracle, matting);
    refuse_two_tasks(options);
  };
  return program.run(argc, argv, [&] { run(options, program.common); });
}
