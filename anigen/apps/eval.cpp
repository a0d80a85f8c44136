#include <algorithm>
#include <cstdio>

#include "anigen/apps/common/command_line.h"
#include "anigen/apps/common/torch_half.h"
#include "anigen/apps/eval_arguments.h"
#include "anigen/core/error.h"
#include "anigen/core/log.h"
#include "anigen/core/parallel.h"
#include "anigen/eval/comparison.h"
#include "anigen/eval/evaluate_command.h"
#include "anigen/eval/skin_evaluation.h"

namespace {

using namespace anigen;

constexpr const char* kShapeGroup = "Rigged shapes (--pred)";
constexpr const char* kStructureGroup = "Sparse structures (--ss-flow)";

void evaluate_skins(const EvalArguments& options, const CommonOptions& common) {
  eval::SkinRequest request;
  request.dataset = options.truth;
  request.splits = {options.splits.begin(), options.splits.end()};
  request.out = options.out;
  request.pictured = options.pictured;
  request.report = !options.no_report;
  if (!options.skin_ae.empty()) {
    request.run = options.skin_ae;
    request.settings["skin_ae"] = options.skin_ae;
    request.methods.push_back(torch_half("--skin-ae").skin_reconstruction(options.skin_ae, common, request.settings));
  }
  request.skins = options.skins;
  const eval::SkinEvaluation evaluation = eval::run_skin_evaluation(request);
  std::fputs(common.json ? (to_json(evaluation).dump(2) + "\n").c_str() : to_markdown(evaluation).c_str(), stdout);
  eval::require_scores(evaluation, options.out);
}

void evaluate_shapes(const EvalArguments& options, const CommonOptions& common) {
  eval::EvaluationRequest request;
  request.predictions = options.predictions;
  request.truth = options.truth;
  request.splits = {options.splits.begin(), options.splits.end()};
  request.category_splits = {options.category_splits.begin(), options.category_splits.end()};
  request.most = options.most;
  request.out = options.out;
  request.prediction_axes = io::parse_axes(options.prediction_axes);
  request.truth_axes = io::parse_axes(options.truth_axes);
  request.settings = options.settings;
  request.settings.seed = common.seed;
  if (!options.lpips_weights.empty()) torch_half("--lpips-weights").add_perceptual_metric(options, common, request);
  if (options.workers > 0) set_thread_count(options.workers);
  request.settings.alignment.icp = !options.no_icp;
  request.settings.transport = eval::parse_transport(options.transport);
  request.settings.alignment.normalization = metrics::normalization_mode(options.normalization);
  if (options.point_to_plane) request.settings.alignment.registration.variant = metrics::IcpVariant::kPointToPlane;
  if (!options.groups.empty()) request.settings.groups = {options.groups.begin(), options.groups.end()};
  request.resume = !options.no_resume;
  request.accept_other_code = options.accept_other_code;
  request.report = !options.no_report;
  request.pictured = options.pictured;
  request.worst_by = options.worst_by;
  request.motion = options.motion;
  request.motions_pictured = options.motions_pictured;
  const eval::Comparison comparison = eval::run_evaluation(request);
  std::fputs(common.json ? (eval::to_json(comparison).dump(2) + "\n").c_str() : to_markdown(comparison).c_str(),
             stdout);
  for (std::size_t m = 0; m < comparison.methods.size(); ++m) {
    if (eval::failures(comparison, m) == comparison.ids.size())
      throw Error("no asset could be evaluated for " + comparison.methods[m] + "; " + options.out +
                  "/metrics.csv says why");
  }
}

void run(const EvalArguments& options, const CommonOptions& common) {
  if (!options.category_splits.empty() && options.predictions.empty())
    throw InputError("", "--category-split", "sorts rigged shapes: it needs --pred");
  if (options.most > 0 && options.ss_flow.empty() && (options.predictions.empty() || options.truth.empty()))
    throw InputError("", "--most", "goes with --pred and --gt, or with --ss-flow");
  if (!options.ss_flow.empty()) {
    if (!options.predictions.empty() || !options.skin_ae.empty() || !options.skins.empty())
      throw InputError("", "--ss-flow", "evaluates a flow of sparse structures, and nothing else at the same time");
    if (options.splits.size() > 1) throw InputError("", "--split", "one file of ids, with --ss-flow");
    return torch_half("--ss-flow").evaluate_structures(options, common);
  }
  if (!options.predictions.empty()) {
    if (!options.skin_ae.empty() || !options.skins.empty())
      throw InputError("", "--pred",
                       "compares rigged shapes; --skin-ae and --skins evaluate weights: one or the other");
    return evaluate_shapes(options, common);
  }
  if (!options.motion.empty() || options.motions_pictured > 0)
    throw InputError("", options.motion.empty() ? "--motion-pictures" : "--motion",
                     "moves rigged shapes: it needs --pred");
  if (!options.lpips_weights.empty())
    throw InputError("", "--lpips-weights", "compares pictures of rigged shapes: it needs --pred");
  if (options.truth.empty()) throw InputError("", "--gt", "which ground truth? A file, a folder or a dataset");
  evaluate_skins(options, common);
}

void add_shape_options(CLI::App& app, EvalArguments& options) {
  auto& icp = options.settings.alignment.registration;
  const char* group = kShapeGroup;
  app.add_option("--normalize", options.normalization, "centroid-rms, bounding-box or none")
      ->capture_default_str()
      ->group(group);
  app.add_flag("--no-icp", options.no_icp, "Normalise only, do not register")->group(group);
  app.add_option("--rotations", icp.rotations, "Random rotations that registration starts from, beside the identity")
      ->check(whole_number(0, 100'000))
      ->capture_default_str()
      ->group(group);
  app.add_flag("--icp-scale", icp.similarity, "Registration may change the scale")->group(group);
  app.add_flag("--icp-plane", options.point_to_plane, "Point-to-plane registration")->group(group);
  app.add_option("--icp-trim", icp.trim, "Fraction of the closest correspondences to keep")
      ->check(number(0, 1, RangeEnds::kOpenBelow))
      ->capture_default_str()
      ->group(group);
  app.add_flag("--exhaustive", icp.exhaustive, "Refine every start, without pruning")->group(group);
  app.add_option("--metrics", options.groups, "Only these: skeleton, transport, skin, motion, surface, image, anymate")
      ->delimiter(',')
      ->group(group);
  app.add_option("--transport", options.transport,
                 "How W and GW are computed: exact, or sinkhorn with its entropic regularisation")
      ->check(CLI::IsMember({"exact", "sinkhorn"}))
      ->capture_default_str()
      ->group(group);
  app.add_option("--epsilon", options.settings.epsilon,
                 "Regularisation of --transport sinkhorn, as a share of the largest squared distance [0.001 for W, "
                 "0.005 for GW]")
      ->check(number(0, 1, RangeEnds::kOpenBelow))
      ->group(group);
  app.add_option("--category-split", options.category_splits,
                 "Files of ids of the ground truth: is the one nearest to a prediction of its category (metric "
                 "'category')?")
      ->type_name("FILE")
      ->group(group);
  app.add_option("--surface-samples", options.settings.surface_samples, "Points per surface")
      ->check(whole_number(1, 10'000'000))
      ->capture_default_str()
      ->group(group);
  app.add_option("--image-size", options.settings.image_size, "Pixels of the views for PSNR, SSIM and LPIPS")
      ->check(whole_number(16, 4096))
      ->capture_default_str()
      ->group(group);
  app.add_option("--lpips-weights", options.lpips_weights,
                 "Files (.pth, .pt, .safetensors) with torchvision's vgg16 and with the linear heads of LPIPS v0.1, or "
                 "one with both; without, LPIPS is not computed")
      ->expected(1, 2)
      ->type_name("FILE [FILE]")
      ->group(group);
  app.add_option("--poses", options.settings.poses, "Poses of the deformation error")
      ->check(whole_number(1, 10'000))
      ->capture_default_str()
      ->group(group);
  app.add_option(
         "--motion", options.motion,
         "Motion that every ground truth is given, and its predictions with it: a .bvh, or a clip of a rigged "
         ".glb, .gltf, .fbx or .dae (FILE#CLIP). Without, the first clip of the ground truth itself; without one, "
         "random poses")
      ->type_name("FILE[#CLIP]")
      ->group(group);
  app.add_option("--motion-frames", options.settings.motion_frames, "Frames of a motion that are compared")
      ->check(whole_number(1, 10'000))
      ->capture_default_str()
      ->group(group);
  app.add_option("--motion-pictures", options.motions_pictured,
                 "Assets to draw in motion, ground truth beside every prediction: in the report, and as frames and GLB "
                 "in OUT/motion")
      ->check(whole_number(0, 10'000))
      ->capture_default_str()
      ->group(group);
  app.add_option("--workers", options.workers, "Pairs evaluated at once; without, as many as --threads")
      ->check(whole_number(1, 1024))
      ->group(group);
  app.add_option("--pred-axes", options.prediction_axes, "Up axis of predictions: format, y-up, z-up")->group(group);
  app.add_option("--gt-axes", options.truth_axes, "Up axis of the ground truth: format, y-up, z-up")->group(group);
  app.add_option("--worst-by", options.worst_by, "Metric that orders the report's assets")->group(group);
  CLI::Option* again =
      app.add_flag("--no-resume", options.no_resume, "Compute pairs again that an earlier run finished")->group(group);
  app.add_flag("--accept-other-code", options.accept_other_code,
               "Keep pairs that another build of this program finished, when all else is the same")
      ->excludes(again)
      ->group(group);
}

void add_structure_options(CLI::App& app, EvalArguments& options) {
  const char* group = kStructureGroup;
  app.add_option("--ss-flow", options.ss_flow, "Run folder of stage 4: generate voxels from pictures and compare them")
      ->group(group);
  app.add_option("--ss-dae", options.ss_dae, "Run folder of stage 2 [as the flow's config says]")->group(group);
  app.add_option("--guidance", options.strengths, "Strengths of guidance to try [as the flow's config says]")
      ->delimiter(',')
      ->check(number(0, 1000))
      ->group(group);
  app.add_option("--steps", options.steps, "Steps of the sampler [as the flow's config says]")
      ->check(whole_number(1, 100'000))
      ->group(group);
  app.add_option("--train-split", options.train_split, "Ids that retrieval chooses from [as the flow's config says]")
      ->group(group);
  app.add_option("--retrieval-views", options.views,
                 "Random views of a training asset to compare with; 0: no retrieval")
      ->check(whole_number(0, 1000))
      ->capture_default_str()
      ->group(group);
}

/// Refuses whatever was given of a group of options.
void refuse_group(const CLI::App& app, const char* group, const std::string& reason) {
  for (const CLI::Option* option : app.get_options())
    if (option->get_group() == group) refuse_given(app, {option->get_name()}, reason);
}

/// Options of another evaluation than the one asked for, or that others leave without effect.
void refuse_ignored(const CLI::App& app, const EvalArguments& options) {
  const bool structures = !options.ss_flow.empty(), shapes = !options.predictions.empty();
  if (!structures) refuse_group(app, kStructureGroup, "is of sparse structures: it needs --ss-flow");
  if (!shapes) refuse_group(app, kShapeGroup, "is of rigged shapes: it needs --pred");
  if (structures) {
    refuse_given(app, {"--json"}, "--ss-flow prints a table; OUT/metrics.json has its numbers");
    refuse_given(app, {"--no-report"}, "--ss-flow writes no report");
  } else if (options.no_report) {
    refuse_given(app, {"--pictures"}, "--no-report writes no pictures");
  }
  if (!structures && !shapes) refuse_given(app, {"--seed"}, "the evaluation of weights draws nothing at random");
  if (!structures && options.skin_ae.empty() && options.lpips_weights.empty()) {
    refuse_given(app, {"--device"},
                 "is of networks, which only --ss-flow, --skin-ae and --lpips-weights use; the rest is for the CPU");
  }
  if (options.no_icp) {
    refuse_given(app, {"--rotations", "--icp-scale", "--icp-plane", "--icp-trim", "--exhaustive"},
                 "is of the registration that --no-icp leaves out");
  }
  const auto wants = [&](const char* metrics) {
    return options.groups.empty() ||
           std::find(options.groups.begin(), options.groups.end(), metrics) != options.groups.end();
  };
  if (!wants("image")) refuse_given(app, {"--image-size", "--lpips-weights"}, "--metrics leaves 'image' out");
  if (!wants("surface") && !wants("motion"))
    refuse_given(app, {"--surface-samples"}, "--metrics leaves 'surface' and 'motion' out");
  if (!wants("motion") && options.motions_pictured == 0)
    refuse_given(app, {"--motion", "--motion-frames"}, "--metrics leaves 'motion' out");
  if (!wants("skin")) refuse_given(app, {"--poses"}, "--metrics leaves 'skin' out");
}

}  // namespace

int main(int argc, char** argv) {
  keep_freed_memory();
  CLI::App app{
      "Compares predicted rigged shapes, or predicted skin weights alone, with ground truth.\n"
      "Writes metrics.json, metrics.csv, table.md, table.tex and report.html. docs/metrics.md defines every number.\n\n"
      "Examples:\n"
      "  anigen-eval --pred generated/ --gt rigs/ --out results\n"
      "  anigen-eval --pred ours=generated/ --pred unirig=other/ --gt articulation_xlv2_test.npz --split test.txt "
      "--out "
      "results\n"
      "  anigen-eval --pred a=one/ --pred b=two/ --gt rigs/ --out results --motion walk.bvh --motion-pictures 3\n"
      "  anigen-eval --pred pairs.csv --out results          (CSV with columns pred, gt and perhaps id)\n"
      "  anigen-eval --skin-ae runs/skin_ae --gt data --split data/splits/test.txt --out results\n"
      "  anigen-eval --gt data --out results                 (skinning baselines only)\n"
      "  anigen-eval --ss-flow runs/ss_flow --gt data --split splits/test.txt --out results   (voxels from pictures)"};
  CommonOptions common;
  EvalArguments options;
  app.add_option("--pred", options.predictions,
                 "[NAME=]PATH of predictions: a file, a folder, or a CSV of pairs; repeat");
  app.add_option("--gt", options.truth, "Ground truth: a file, a folder or a dataset");
  app.add_option("--split", options.splits, "Files of ids to evaluate; without, everything");
  app.add_option("--most", options.most, "With --pred or --ss-flow, only so many of the first assets; 0: all")
      ->check(whole_number(0))
      ->capture_default_str();
  app.add_option("--out", options.out, "Folder for the results")->required();
  app.add_option("--skin-ae", options.skin_ae, "Run folder or checkpoint of a skin auto-encoder to reconstruct with")
      ->group("Skin weights alone");
  app.add_option("--skins", options.skins,
                 "Folder of NPZ files with skin [V, J] for the ground truth's vertices, found by any name of the asset")
      ->group("Skin weights alone");
  app.add_option("--pictures", options.pictured, "Assets to draw in the report: worst (and, of weights, best) ones")
      ->check(whole_number(0, 100'000))
      ->capture_default_str();
  app.add_flag("--no-report", options.no_report, "Do not write report.html");
  add_shape_options(app, options);
  add_structure_options(app, options);
  add_common_options(app, common, library_versions());
  return run_command(app, common, argc, argv, [&] {
    refuse_ignored(app, options);
    run(options, common);
  });
}
