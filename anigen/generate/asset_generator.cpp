#include "anigen/generate/asset_generator.h"

#include <chrono>

#include "anigen/core/error.h"
#include "anigen/core/log.h"
#include "anigen/core/process.h"
#include "anigen/generate/run_weights.h"
#include "anigen/nn/profile.h"
#include "anigen/sparse_structure/autoencoder.h"

namespace anigen::generate {

namespace {

using torch::Tensor;

class Stopwatch {
 public:
  /// Seconds since the last call.
  double lap() {
    const auto now = std::chrono::steady_clock::now();
    const double seconds = std::chrono::duration<double>(now - last_).count();
    last_ = now;
    return seconds;
  }

 private:
  std::chrono::steady_clock::time_point last_ = std::chrono::steady_clock::now();
};

flow::SamplingExtras with_progress(Progress& progress) {
  flow::SamplingExtras extras;
  extras.progress = [&](std::int64_t, std::int64_t) {
    throw_if_interrupted();
    progress.advance();
  };
  return extras;
}

bool sees_normals(const AssetGenerator::Request& request, const StructureGenerator& flow) {
  if (request.structure_condition != StructureCondition::kAsTrained)
    return request.structure_condition == StructureCondition::kNormal;
  if (flow.reading().condition == data::ConditionPictures::kNormals) return true;
  // Published configs say nothing of it.
  return !flow.flow().run.contains(Json::json_pointer("/dataset/args/condition")) &&
         !nn::has_training_state(request.structure_flow);
}

/// @throws InputError without a picture
void require_views(const Tensor& pictures) {
  if (!pictures.defined() || pictures.dim() != 4 || pictures.size(0) == 0)
    throw InputError("", "views", "no image of the object");
}

void require_same_views(const Tensor& first, const Tensor& second, const GenerationOptions& options) {
  if (options.given_voxels || !first.defined() || !second.defined() || first.size(0) == second.size(0)) return;
  throw InputError("", "views",
                   "the first flow is given " + std::to_string(first.size(0)) + " views, the second " +
                       std::to_string(second.size(0)) + ": both see all images of the object");
}

/// Adds the runs that a flow's image encoder asks: a picture estimator, another flow.
void add_encoder_runs(const nn::RunModel& flow, const std::filesystem::path& run,
                      std::vector<std::filesystem::path>& runs) {
  for (const char* pointer : {"/trainer/args/image_encoder/estimator", "/trainer/args/image_encoder/flow"}) {
    const Json::json_pointer place(pointer);
    if (!flow.run.contains(place) || !flow.run.at(place).is_string()) continue;
    const std::string name = flow.run.at(place).get<std::string>();
    if (!name.empty()) runs.push_back(nn::named_run(run, name, flow.config, pointer));
  }
}

}  // namespace

flow::SamplerOptions SamplerOverrides::over(flow::SamplerOptions options) const {
  options.steps = steps.value_or(options.steps);
  options.solver = solver.value_or(options.solver);
  options.cfg_strength = cfg_strength.value_or(options.cfg_strength);
  if (cfg_interval) options.cfg_interval = cfg_interval;
  options.cfg_every = cfg_every.value_or(options.cfg_every);
  options.velocity_tolerance = velocity_tolerance.value_or(options.velocity_tolerance);
  options.windowed_steps = windowed_steps.value_or(options.windowed_steps);
  options.validate();
  if (options.cfg_strength == 0.0 && (cfg_interval || cfg_every.value_or(1) > 1))
    log::warn_once("the flow samples without guidance: when and how often it guides changes nothing");
  const bool as_euler = solver && *solver != flow::Solver::kMidpoint && *solver != flow::Solver::kEuler;
  if (options.steps == 1 && (as_euler || velocity_tolerance.value_or(0.0) > 0.0))
    log::warn_once("the flow takes one step: of solvers but midpoint that is Euler's, and nothing is predicted");
  return options;
}

at::Generator noise_generator(std::uint64_t seed) {
  at::Generator generator = at::detail::createCPUGenerator();
  generator.set_current_seed(seed);
  return generator;
}

std::int64_t joints_of_level(int level) {
  constexpr std::int64_t kJoints[] = {0, 10, 15, 25, 35};
  if (level < 0 || level > 4) throw InputError("", "joint density level", "must be 0 … 4");
  return kJoints[level];
}

AssetGenerator::AssetGenerator(const Request& request) : request_(request) {
  // Each once, so that a run that cannot be used is named before anything is sampled.
  const StructureGenerator& first = structure();
  structure_size_ = first.reading().image_size;
  structure_sees_normals_ = sees_normals(request, first);
  structure_decoder_ckpt_ = first.reading().ss_dec_ckpt;
  const bool structure_alone = first.shape_alone();
  runs_ = {request.structure_flow, request.latent_flow, first.autoencoder()};
  std::vector<std::filesystem::path> asked;
  add_encoder_runs(first.flow(), request.structure_flow, asked);
  forget_unless_kept();
  const StructuredLatentGenerator& second = latents();
  latent_size_ = second.reading().image_size;
  grid_ = second.options().resolution;
  counts_joints_ = second.options().use_joint_num_cond;
  shape_alone_ = second.options().geometry_only;
  if (structure_alone && !shape_alone_) {
    throw InputError(request.structure_flow.string(), "/models/denoiser/args/geometry_only",
                     "finds no voxels of a skeleton, which the flow " + request.latent_flow.string() + " asks for");
  }
  latent_decoder_ckpt_ = second.reading().slat_dec_ckpt;
  latent_autoencoder_ = request.latent_autoencoder;
  if (latent_autoencoder_.empty()) {
    latent_autoencoder_ = nn::named_run(request.latent_flow, second.reading().slat_dec_path, second.flow().config,
                                        "/dataset/args/slat_dec_path");
  }
  add_encoder_runs(second.flow(), request.latent_flow, asked);
  runs_.push_back(latent_autoencoder_);
  runs_.insert(runs_.end(), asked.begin(), asked.end());
  forget_unless_kept();
  require_grid(decoder().options().resolution, latent_autoencoder_);
  forget_unless_kept();
}

void AssetGenerator::require_grid(std::int64_t found, const std::filesystem::path& run) const {
  if (found == grid_) return;
  throw InputError(run.string(), "",
                   "works on " + std::to_string(found) + "³ voxels, the flow " + request_.latent_flow.string() +
                       " on " + std::to_string(grid_) + "³");
}

skeleton_field::MeanShiftOptions grouping_of_flow(const skeleton_field::MeanShiftOptions& asked,
                                                  const std::filesystem::path& flow,
                                                  const std::filesystem::path& autoencoder) {
  std::error_code error;
  const bool fitted = std::filesystem::is_regular_file(structured_latent::grouping_file(flow), error);
  return structured_latent::grouping_of_run(asked, fitted ? flow : autoencoder);
}

FlowRequest AssetGenerator::flow_request(const std::filesystem::path& run) const {
  return {run, "", request_.averages, request_.device, request_.precision};
}

StructureGenerator& AssetGenerator::structure() {
  if (!structure_) {
    StructureGenerator::Request request{flow_request(request_.structure_flow), request_.structure_autoencoder};
    structure_ = std::make_unique<StructureGenerator>(request);
  }
  return *structure_;
}

StructuredLatentGenerator& AssetGenerator::latents() {
  if (!latents_) latents_ = std::make_unique<StructuredLatentGenerator>(flow_request(request_.latent_flow));
  return *latents_;
}

RigDecoder& AssetGenerator::decoder() {
  if (!decoder_) {
    decoder_ = std::make_unique<RigDecoder>(
        nn::find_run_model(latent_autoencoder_, structured_latent::kStructuredLatentDecoderClass, latent_decoder_ckpt_),
        nn::parse_device(request_.device),
        grouping_of_flow(request_.grouping, request_.latent_flow, latent_autoencoder_),
        shape_alone_ ? RigDecoder::Decodes::kShapes : RigDecoder::Decodes::kRigs);
  }
  return *decoder_;
}

void AssetGenerator::forget_unless_kept() {
  if (!request_.low_memory) return;
  structure_.reset();
  latents_.reset();
  decoder_.reset();
  release_freed_memory();  // the next model's parameters seldom fit into the gaps that these leave
}

StructureCoder AssetGenerator::structure_coder() const {
  return StructureCoder(runs_[2], structure_decoder_ckpt_, nn::parse_device(request_.device), /*decodes=*/true);
}

StructuredLatentCoder AssetGenerator::latent_coder() const {
  return StructuredLatentCoder(latent_autoencoder_, latent_decoder_ckpt_, nn::parse_device(request_.device),
                               /*decodes=*/std::nullopt);
}

sparse_structure::VoxelPair AssetGenerator::sample_voxels(const Tensor& structure_pictures, const std::string& name,
                                                          const GenerationOptions& options) {
  GeneratedAsset made;
  sample_structure(structure_pictures, name, options, noise_generator(options.seed), made);
  return made.voxels;
}

void AssetGenerator::sample_structure(const Tensor& pictures, const std::string& name, const GenerationOptions& options,
                                      const at::Generator& generator, GeneratedAsset& made) {
  const torch::NoGradGuard no_grad;
  StructureGenerator& first = structure();
  const flow::Streams noise = first.noise(generator);
  if (options.given_voxels) {
    made.voxels = *options.given_voxels;
  } else {
    Stopwatch watch;
    const flow::SamplerOptions sampler = options.structure.over(first.sampler());
    require_views(pictures);
    const Tensor tokens = first.condition(pictures);
    made.times.condition += watch.lap();
    Progress progress("sparse structure of " + name, static_cast<std::size_t>(sampler.steps), "steps");
    const flow::Streams sampled =
        first.sample(noise, tokens, sampler, sampler.cfg_strength > 0, with_progress(progress), options.views);
    made.structure = first.denormalised(sampled);
    made.voxels = first.decode(sampled).front();
    made.times.structure = watch.lap();
  }
  forget_unless_kept();
  require_grid(made.voxels.shape.size(0), request_.structure_flow);
}

void AssetGenerator::sample_latents(const Tensor& pictures, const std::string& name, const GenerationOptions& options,
                                    const at::Generator& generator, GeneratedAsset& made) {
  structured_latent::StructuredLatentTarget target;
  target.shape = support_of(made.voxels.shape);
  // A flow of the shape alone has no skeleton voxels; it answers zeros wherever it is asked.
  target.skeleton = shape_alone_ ? target.shape : support_of(made.voxels.skeleton);
  Stopwatch watch;
  StructuredLatentGenerator& second = latents();
  const flow::SamplerOptions sampler = options.latents.over(second.sampler());
  require_views(pictures);
  target.tokens = second.condition(pictures);
  made.cameras = second.cameras(pictures);
  if (counts_joints_)
    target.joints_num = torch::tensor({options.joints}, torch::kInt64).to(nn::parse_device(request_.device));
  made.times.condition += watch.lap();
  Progress progress("structured latents of " + name, static_cast<std::size_t>(sampler.steps), "steps");
  made.latents = second.sample(second.noise(*target.shape, *target.skeleton, generator), target, sampler,
                               sampler.cfg_strength > 0, with_progress(progress), options.views);
  made.times.latents = watch.lap();
  forget_unless_kept();
}

GeneratedAsset AssetGenerator::generate(const Tensor& structure_pictures, const Tensor& latent_pictures,
                                        const std::string& name, const GenerationOptions& options) {
  if (options.joints < 0) throw InputError("", "joints", "must not be negative");
  if (options.joints > 0 && !counts_joints_) {
    throw InputError(request_.latent_flow.string(), "/models/denoiser/args/use_joint_num_cond",
                     "a number of joints was asked for, but this flow was not trained to be told one");
  }
  const torch::NoGradGuard no_grad;
  GeneratedAsset made;
  if (options.given_latents) {
    made.latents = *options.given_latents;
  } else {
    require_same_views(structure_pictures, latent_pictures, options);
    const at::Generator generator = noise_generator(options.seed);
    sample_structure(structure_pictures, name, options, generator, made);
    made.shape_voxels = made.voxels.shape.sum().item<std::int64_t>();
    made.skeleton_voxels = shape_alone_ ? 0 : made.voxels.skeleton.sum().item<std::int64_t>();
    if (made.shape_voxels == 0 || (made.skeleton_voxels == 0 && !shape_alone_)) {
      throw Error(name + ": the first flow gave no " + (made.shape_voxels == 0 ? "shape" : "skeleton") +
                  " voxels; another seed may");
    }
    if (options.voxels_found) options.voxels_found(made.voxels);
    if (options.voxels_alone) return made;
    sample_latents(latent_pictures, name, options, generator, made);
  }
  made.shape_voxels = made.latents.geometry.support->size();
  made.skeleton_voxels = shape_alone_ ? 0 : made.latents.skeleton.support->size();
  Stopwatch watch;
  made.decoded = decoder().decode(made.latents, nullptr, name);
  forget_unless_kept();
  made.times.decode = watch.lap();
  return made;
}

}  // namespace anigen::generate
