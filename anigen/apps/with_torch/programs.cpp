#include <algorithm>
#include <array>
#include <cstdio>
#include <memory>
#include <string>
#include <utility>

#include "anigen/apps/animate_arguments.h"
#include "anigen/apps/common/command_line.h"
#include "anigen/apps/common/torch_half.h"
#include "anigen/apps/eval_arguments.h"
#include "anigen/apps/generate_arguments.h"
#include "anigen/apps/rig_arguments.h"
#include "anigen/apps/with_torch/generation_request.h"
#include "anigen/core/error.h"
#include "anigen/core/parallel.h"
#include "anigen/eval/skin_evaluation.h"
#include "anigen/generate/anymate_rigger.h"
#include "anigen/generate/encode.h"
#include "anigen/generate/encode_report.h"
#include "anigen/generate/evaluate.h"
#include "anigen/generate/evaluate_matting.h"
#include "anigen/generate/field_rigger.h"
#include "anigen/generate/generate_assets.h"
#include "anigen/generate/oracle.h"
#include "anigen/generate/picture_distances.h"
#include "anigen/generate/retrieve.h"
#include "anigen/generate/rignet_rigger.h"
#include "anigen/generate/run_weights.h"
#include "anigen/generate/trained_skin.h"
#include "anigen/generate/video_animation.h"
#include "anigen/io/write_rigged.h"
#include "anigen/nn/profile.h"
#include "anigen/train/distributed/launch.h"
#include "anigen/train/export_run.h"
#include "anigen/train/train_command.h"
#include "anigen/train/tune.h"
#include "anigen/vision/voxel_features.h"

namespace anigen {

namespace {

void require_latents(const generate::EncodedLatents& result, const CommonOptions& common) {
  if (result.failed.empty()) return;
  require_inputs(result.failed.size(), result.assets,
                 "assets could not be encoded (the first: " + result.failed.begin()->second + ")", common);
}

void reconstruct(const generate::ReconstructRequest& request, const CommonOptions& common) {
  const std::vector<generate::ReconstructedAsset> made = generate::reconstruct_assets(request);
  print_result(generate::to_json(made), generate::to_text(made), common);
  require_inputs(made, "assets gave no file", common);
}

void run_encode(const EncodeArguments& arguments, const CommonOptions& common) {
  nn::set_up_computing(common.threads);
  if (arguments.task == EncodeArguments::Task::kReconstruct) return reconstruct(arguments.rebuilt, common);
  if (arguments.task == EncodeArguments::Task::kGrouping) {
    const generate::GroupingFit fit = generate::fit_grouping(arguments.grouped);
    return print_result(to_json(fit), to_markdown(fit), common);
  }
  if (arguments.task == EncodeArguments::Task::kStructure) {
    const generate::EncodeResult result = generate::encode_sparse_structure(arguments.encoded);
    print_result(to_json(result), to_text(result), common);
    return require_latents(result, common);
  }
  const generate::EncodedLatents result = generate::encode_structured_latents(arguments.encoded);
  print_result(to_json(result), to_text(result, "latents"), common);
  require_latents(result, common);
}

eval::SkinMethod skin_reconstruction(const std::string& run, const CommonOptions& common, Json& settings) {
  nn::set_up_computing(common.threads);
  const auto model = std::make_shared<generate::SkinReconstruction>(run, common.device);
  settings["checkpoint"] = model->checkpoint().string();
  settings["parameters"] = model->parameters();
  settings["features_per_vertex"] = model->features_per_vertex();
  eval::SkinMethod method;
  method.key = "skin_ae";
  method.label = "SkinAE reconstruction";
  method.parallel = false;
  method.predict = [model](const io::DatasetItem&, const eval::GroundTruth& truth) {
    return model->reconstruct(truth.joints, truth.parents, truth.skin);
  };
  return method;
}

void add_perceptual_distances(const EvalArguments& arguments, const CommonOptions& common,
                              eval::EvaluationRequest& request) {
  nn::set_up_computing(common.threads);
  if (!arguments.lpips_weights.empty()) {
    const std::vector<std::filesystem::path> files(arguments.lpips_weights.begin(), arguments.lpips_weights.end());
    const auto lpips = std::make_shared<generate::LpipsDistance>(files, common.device);
    request.settings.lpips = lpips->describe();
    request.perceptual.lpips = [lpips](const io::Image& a, const io::Image& b) { return lpips->distance(a, b); };
  }
  if (!arguments.image_encoder.empty()) {
    const auto encoder = std::make_shared<generate::EncoderDistance>(arguments.image_encoder, common.device);
    request.settings.image_encoder = encoder->describe();
    request.perceptual.encoder = [encoder](const io::Image& a, const io::Image& b) { return encoder->distance(a, b); };
  }
}

void evaluate_structures(const EvalArguments& arguments, const CommonOptions& common) {
  nn::set_up_computing(common.threads);
  generate::StructureEvaluationRequest request;
  request.run = arguments.ss_flow;
  request.autoencoder = arguments.ss_dae;
  request.data = arguments.dataset;
  request.splits.assign(arguments.splits.begin(), arguments.splits.end());
  request.train_split = arguments.train_split;
  request.out = arguments.output;
  for (const double guidance : arguments.guidance) request.strengths.push_back(guidance - 1);
  request.steps = arguments.steps.value_or(0);
  request.most = arguments.limit;
  request.pictured = arguments.report_images;
  request.retrieval_views = arguments.views;
  request.seed = common.seed.value_or(0);
  request.device = common.device;
  const generate::StructureEvaluation evaluation = generate::evaluate_structures(request);
  std::fputs((to_markdown(evaluation.table()) + "\n").c_str(), stdout);
}

void evaluate_matting(const EvalArguments& arguments, const CommonOptions& common) {
  nn::set_up_computing(common.threads);
  generate::MattingEvaluationRequest request;
  request.matting.network = arguments.matting_network;
  const auto three = [](const std::vector<double>& from, std::array<double, 3>& to) {
    if (from.size() == to.size()) std::copy(from.begin(), from.end(), to.begin());
  };
  three(arguments.matting_mean, request.matting.mean);
  three(arguments.matting_deviation, request.matting.deviation);
  request.data = arguments.dataset;
  request.splits.assign(arguments.splits.begin(), arguments.splits.end());
  request.backgrounds = arguments.backgrounds;
  request.out = arguments.output;
  request.most = arguments.limit;
  request.pictured = arguments.report_images;
  request.seed = common.seed.value_or(0);
  std::fputs((to_markdown(generate::evaluate_matting(request).table()) + "\n").c_str(), stdout);
}

void evaluate_oracle(const EvalArguments& arguments, const CommonOptions& common,
                     const eval::EvaluationRequest& pairs) {
  nn::set_up_computing(common.threads);
  generate::OracleRequest request;
  request.pairs = pairs;
  generate::GenerateRequest& generation = request.generation;
  generation.models.structure_flow = arguments.ss_flow;
  generation.models.latent_flow = arguments.slat_flow;
  generation.models.structure_autoencoder = arguments.ss_dae;
  generation.models.latent_autoencoder = arguments.slat_dae;
  generation.models.device = common.device;
  skeleton_field::MeanShiftOptions& grouping = generation.models.grouping;
  grouping.bandwidth = arguments.cluster_bandwidth.value_or(0.0F);
  grouping.min_cluster_size = arguments.cluster_min_votes.value_or(0);
  if (!arguments.cluster_algorithm.empty()) {
    using Form = skeleton_field::MeanShiftForm;
    grouping.form = arguments.cluster_algorithm == "paper" ? Form::kPaper : Form::kPublished;
  }
  engine::GenerateOptions sampling;
  sampling.seed = common.seed.value_or(sampling.seed);
  sampling.structure_steps = arguments.steps;
  sampling.latent_steps = arguments.slat_steps;
  if (!arguments.guidance.empty()) sampling.structure_guidance = arguments.guidance.front();
  sampling.latent_guidance = arguments.slat_guidance;
  generation.sampling = engine::sampling_options(sampling);
  generation.finishing.views = arguments.hidden_views.value_or(generation.finishing.views);
  generation.finishing.texture_size = arguments.texture_size.value_or(generation.finishing.texture_size);
  generation.again = arguments.force;
  generation.accept_other_code = pairs.accept_other_code;
  generation.output = arguments.output;
  const generate::Oracle oracle = generate::evaluate_oracle(request);
  print_result(to_json(oracle), to_markdown(oracle), common);
  require_inputs(failures(oracle), oracle.assets.size(),
                 "assets lack a row (" + arguments.output + "/oracle.md says why)", common);
}

/// The number of joints that one of three options asks for.
int wanted_joints(const GenerateArguments& arguments) {
  if (arguments.joint_level) return static_cast<int>(generate::joints_of_level(*arguments.joint_level));
  if (arguments.joint_density) return static_cast<int>(*arguments.joint_density * 60 + 0.5);
  return arguments.sampling.joints;
}

std::vector<generate::NamedPicture> pictures_of(const GenerateArguments& arguments) {
  if (!arguments.dataset.empty())
    return generate::pictures_of_dataset(arguments.dataset, arguments.splits, arguments.limit, arguments.image_views);
  if (arguments.images.empty()) throw InputError("", "--image", "which image? Or name a --dataset and a --split");
  std::vector<generate::NamedPicture> pictures;
  for (const std::filesystem::path& image : arguments.images) {
    const std::vector<generate::NamedPicture> found = generate::pictures_at(image);
    pictures.insert(pictures.end(), found.begin(), found.end());
  }
  if (arguments.one_object) {
    if (pictures.size() < 2) throw InputError("", "--one-object", "is for two images or more of the object");
    pictures = {generate::views_of_one(std::move(pictures))};
  }
  if (!arguments.normal_map.empty()) {
    if (pictures.size() != 1 || arguments.one_object) throw InputError("", "--normal-map", "is for one image");
    pictures.front().normal_map = arguments.normal_map;
  }
  if (!arguments.mask.empty()) {
    if (pictures.size() != 1 || arguments.one_object) throw InputError("", "--mask", "is for one image");
    pictures.front().mask = arguments.mask;
  }
  return pictures;
}

/// Sets what the library has no option for.
void set_models(const GenerateArguments& arguments, generate::AssetGenerator::Request& models) {
  models.structure_autoencoder = arguments.structure_autoencoder;
  models.latent_autoencoder = arguments.latent_autoencoder;
  models.grouping = arguments.clustering;
  if (arguments.averages) models.averages = nn::Averages::kAlways;
  if (arguments.no_averages) models.averages = nn::Averages::kNever;
  if (arguments.structure_condition == "color") {
    models.structure_condition = generate::StructureCondition::kColor;
  } else if (arguments.structure_condition == "normal") {
    models.structure_condition = generate::StructureCondition::kNormal;
  }
}

/// Sets what the library has no option for.
void set_sampling(const GenerateArguments& arguments, generate::GenerationOptions& sampling) {
  const auto interval = [](const std::vector<double>& ends) { return std::make_pair(ends[0], ends[1]); };
  if (!arguments.structure_interval.empty()) sampling.structure.cfg_interval = interval(arguments.structure_interval);
  if (!arguments.latent_interval.empty()) sampling.latents.cfg_interval = interval(arguments.latent_interval);
  sampling.views = flow::parse_view_rule(arguments.view_rule);
  sampling.structure.cfg_every = sampling.latents.cfg_every = arguments.guidance_every;
  sampling.structure.velocity_tolerance = sampling.latents.velocity_tolerance = arguments.velocity_tolerance;
  sampling.structure.windowed_steps = sampling.latents.windowed_steps = arguments.windowed_steps;
  if (!arguments.solver.empty())
    sampling.structure.solver = sampling.latents.solver = flow::parse_solver(arguments.solver);
}

generate::GenerateRequest request_of(const GenerateArguments& arguments, const CommonOptions& common) {
  engine::GeneratorOptions models = arguments.models;
  models.device = common.device;
  models.image_colors = arguments.colors == "picture";
  engine::GenerateOptions sampling = arguments.sampling;
  sampling.seed = common.seed.value_or(sampling.seed);
  sampling.joints = wanted_joints(arguments);
  models.counts_joints = sampling.joints > 0;
  generate::GenerateRequest request = engine::generation_request(models);
  request.sampling = engine::sampling_options(sampling);
  set_models(arguments, request.models);
  set_sampling(arguments, request.sampling);
  request.voxels = arguments.voxels;
  request.pictures.normals = generate::parse_normal_source(arguments.normals);
  request.pictures.matting = arguments.mask.empty()
                                 ? engine::with_shipped_matting(arguments.matting, request.pictures.background)
                                 : arguments.matting;
  request.estimator_weights = arguments.estimator_weights;
  request.finishing = arguments.finishing;
  request.finishing.remove_hidden = !arguments.keep_hidden;
  request.finishing.filter_skin = !arguments.keep_weights;
  if (arguments.no_smoothing) request.finishing.smoothing_iterations = 0;
  request.published_axes = arguments.axes == "published";
  request.idle = !arguments.still;
  request.obj = arguments.obj;
  request.intermediate = arguments.intermediate;
  request.again = arguments.force;
  request.accept_other_code = arguments.accept_other_code;
  request.output = arguments.output;
  request.name = arguments.asset_name;
  return request;
}

void run_generate(const GenerateArguments& arguments, const CommonOptions& common) {
  nn::set_up_computing(common.threads);
  const std::vector<generate::NamedPicture> pictures = pictures_of(arguments);
  const generate::GenerateRequest request = request_of(arguments, common);
  // Earlier versions made folders of such names.
  const bool to_file = io::is_rigged_output(request.output) && !std::filesystem::is_directory(request.output);
  if (to_file && pictures.size() != 1) {
    throw InputError(request.output.string(), "--output",
                     "a file holds one asset, and these are " + std::to_string(pictures.size()) +
                         " images: name a folder, or say --one-object when all show one");
  }
  const auto reports = to_file ? std::vector{generate::generate_file(request, pictures.front())}
                               : generate::generate_assets(request, pictures);
  print_result(generate::to_json(reports), generate::to_text(reports), common);
  require_inputs(reports, "images gave no asset", common);
}

rigging::LearnedSteps field_steps(const RigArguments& arguments, const CommonOptions& common) {
  generate::FieldRigger::Request request;
  request.flows = arguments.joint_model.empty() ? generate::shipped_rig_flows()
                                                : generate::find_flow_runs(arguments.joint_model, false);
  if (request.flows.structure.empty()) {
    throw InputError("", "--method anigen",
                     "no rig/ss_flow and rig/slat_flow are among the weights that come with this program; name a "
                     "folder of both flows with --joint-model");
  }
  request.device = common.device;
  if (common.seed) request.seed = *common.seed;
  return generate::FieldRigger::steps(std::make_shared<generate::FieldRigger>(request));
}

rigging::LearnedSteps learned_steps(const RigArguments& arguments, const CommonOptions& common) {
  nn::set_up_computing(common.threads);
  if (arguments.rig.method == kAnigen) return field_steps(arguments, common);
  const generate::LearnedModelFiles files{arguments.joint_model, arguments.connectivity_model, arguments.skin_model};
  const torch::Device device = nn::parse_device(common.device);
  const std::size_t influences = arguments.request.binding.heat.most_influences;
  if (arguments.rig.method == kAnymate) {
    generate::AnymateRiggerOptions rigger;
    rigger.points = arguments.points;
    rigger.eps = arguments.joint_distance;
    rigger.joints = arguments.request.edits.joints;
    rigger.seed = common.seed.value_or(0);
    rigger.most_influences = influences;
    rigger.device = device;
    return generate::LearnedRigger::steps(
        std::make_shared<generate::AnymateRigger>(generate::load_anymate_models(files, device), rigger));
  }
  generate::RignetRiggerOptions rigger;
  rigger.seed = common.seed.value_or(0);
  rigger.most_influences = influences;
  rigger.device = device;
  return generate::LearnedRigger::steps(
      std::make_shared<generate::RignetRigger>(generate::load_rignet_models(files, device), rigger));
}

void animate_from_video(const AnimateArguments& arguments, const CommonOptions& common) {
  nn::set_up_computing(common.threads);
  generate::VideoAnimationRequest request;
  request.asset = arguments.asset;
  request.video = arguments.video;
  request.out = arguments.request.out;
  request.sheet = arguments.pictures;
  request.fps = arguments.video_fps;
  request.keep_clips = !arguments.drop_clips;
  request.background = generate::parse_background(arguments.background);
  request.matting.network = arguments.matting_network;
  request.matting = engine::with_shipped_matting(request.matting, request.background);
  const generate::VideoAnimationReport report = generate::animate_from_video(request);
  print_result(generate::to_json(report), generate::to_text(report), common);
}

rigging::LearnedSteps learned_skin(const RigArguments& arguments, const CommonOptions& common) {
  nn::set_up_computing(common.threads);
  const std::filesystem::path run =
      arguments.skin_run.empty() ? generate::shipped_skin_correction() : std::filesystem::path(arguments.skin_run);
  if (run.empty()) {
    throw InputError("", "--skin learned",
                     "no skin_correction is among the weights that come with this program; name a run of "
                     "AniGenSkinCorrectionTrainer with --skin-run");
  }
  return generate::TrainedSkin::steps(std::make_shared<generate::TrainedSkin>(run),
                                      arguments.request.binding.heat.most_influences);
}

std::vector<eval::SkinMethod> skin_corrections(const std::vector<std::string>& runs, const CommonOptions& common,
                                               Json& settings) {
  nn::set_up_computing(common.threads);
  return generate::skin_correction_methods({runs.begin(), runs.end()}, settings);
}

void retrieve(const RigArguments& arguments, const CommonOptions& common) {
  nn::set_up_computing(common.threads);
  generate::RetrievalRequest request;
  request.dataset = arguments.request.joints.collection;
  request.splits = arguments.request.joints.splits;
  request.encoder = arguments.retrieval_encoder;
  request.device = common.device;
  request.views = arguments.views;
  request.pictures.background = generate::parse_background(arguments.background);
  request.seen = arguments.condition == "normal" ? data::ConditionPictures::kNormals : data::ConditionPictures::kColor;
  request.output = arguments.request.out;
  const auto pictures =
      arguments.image.empty()
          ? generate::pictures_of_dataset(
                arguments.image_dataset.empty() ? request.dataset : std::filesystem::path(arguments.image_dataset),
                {arguments.image_splits.begin(), arguments.image_splits.end()}, arguments.limit)
          : generate::pictures_at(arguments.image);
  const auto reports = generate::retrieve_assets(request, pictures);
  print_result(to_json(reports), to_text(reports), common);
  require_inputs(reports, "images gave no rig", common);
}

train::TrainCommand command_of(const TrainArguments& arguments, const CommonOptions& common) {
  train::TrainCommand command;
  command.config = arguments.config;
  command.overrides = arguments.overrides;
  command.data_dir = arguments.dataset;
  command.run.output = arguments.output;
  command.run.load = arguments.load;
  command.run.ckpt = arguments.ckpt;
  command.run.restart = arguments.restart;
  command.run.profile_steps = arguments.profile_steps;
  command.extend_to = arguments.extend_to;
  command.run.threads = thread_count();
  command.device = common.device;
  command.ranks.timeout = arguments.rank_timeout;
  command.ranks.sent = arguments.communication == "bf16" ? torch::kBFloat16 : torch::kFloat32;
  command.command_line = joined(arguments.words, " ");
  if (common.seed) command.overrides.push_back("trainer.args.seed=" + std::to_string(*common.seed));
  if (!arguments.warm_start.empty()) {
    command.overrides.push_back(arguments.warm_start == "none" ? std::string("trainer.args.warm_start=none")
                                                               : "trainer.args.pretrained_dir=" + arguments.warm_start);
  }
  return command;
}

void check_train_config(const TrainArguments& arguments, const CommonOptions& common) {
  train::describe_config(command_of(arguments, common), train::ConfigView::kFull);
}

int run_train(const TrainArguments& arguments, const CommonOptions& common) {
  const train::LaunchEnvironment environment = train::read_launch_environment(arguments.rendezvous);
  if (!arguments.ranks_given && environment.launcher.empty() && !arguments.only_of_ranks.empty()) {
    throw InputError("", arguments.only_of_ranks.front(),
                     "is for several processes: there is neither --ranks nor a launcher");
  }
  if (arguments.schema || arguments.print_config) {
    const auto view = arguments.schema ? train::ConfigView::kSchema : train::ConfigView::kFull;
    std::fputs((train::describe_config(command_of(arguments, common), view).dump(2) + "\n").c_str(), stdout);
    return 0;
  }
  if (!arguments.export_to.empty()) {
    const auto precision =
        arguments.export_precision == "int8" ? train::ExportPrecision::kInt8 : train::ExportPrecision::kHalf;
    const train::ExportedRun exported = train::export_run(arguments.output, arguments.export_to, precision);
    std::printf("%s of step %lld: %zu parameters, %.1f MB\n", joined(exported.models).c_str(),
                static_cast<long long>(exported.step), exported.parameters, static_cast<double>(exported.bytes) / 1e6);
    return 0;
  }
  if (arguments.tune) {
    std::fputs(train::to_markdown(train::tune(command_of(arguments, common))).c_str(), stdout);
    return 0;
  }
  if (arguments.ranks > 1 && environment.launcher.empty())
    return train::run_local_ranks({arguments.ranks, arguments.rank_restarts, arguments.rank_timeout}, arguments.words);
  if (arguments.ranks > 1 && arguments.ranks != environment.size) {
    throw InputError(
        "--ranks", std::to_string(arguments.ranks),
        environment.launcher + " has started " + std::to_string(environment.size) + "; leave the option out");
  }
  if (common.threads == 0 && environment.local_size > 1)
    set_thread_count(shared_thread_count(find_cores(), environment.local_size));
  train::TrainCommand command = command_of(arguments, common);
  command.environment = environment;
  train::train(command);
  return 0;
}

std::string describe_weights(const std::string& run, Json& description) {
  description["weights"] = generate::describe_weights(run);
  return generate::first_incomplete(description["weights"]);
}

}  // namespace

/// The entry that torch_half() looks for.
extern "C" __attribute__((visibility("default"))) const TorchHalf* anigen_torch_half() {
  static const TorchHalf half{
      nn::version_details,
      run_encode,
      run_generate,
      run_train,
      check_train_config,
      animate_from_video,
      retrieve,
      learned_steps,
      learned_skin,
      add_perceptual_distances,
      skin_reconstruction,
      skin_corrections,
      evaluate_structures,
      evaluate_matting,
      evaluate_oracle,
      describe_weights,
      vision::make_feature_extractor,
  };
  return &half;
}

}  // namespace anigen
