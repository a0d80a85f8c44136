#include "anigen/train/stages/sparse_structure_autoencoder.h"

#include "anigen/core/config_fields.h"
#include "anigen/core/error.h"
#include "anigen/core/numeric.h"

namespace anigen::train {

namespace {

using torch::Tensor;

constexpr std::size_t kSheetAssets = 8;
constexpr int kBetweenSteps = 5;

// [1, 1, R, R, R] logits or counts → bool [R, R, R] on the CPU.
Tensor occupied_grid(const Tensor& values) { return (values[0][0] > 0).to(torch::kCPU); }

// On the way from a to b; latents of the unit sphere stay on their sphere.
Tensor latent_between(const Tensor& a, const Tensor& b, double share, bool on_sphere,
                      const sparse_structure::SparseStructureEncoderOptions& coder) {
  const Tensor z = torch::lerp(a, b, share);
  return on_sphere ? coder.normalize_scale * sparse_structure::unit_latents(z, coder.norm_order()) : z;
}

void unfreeze(sparse_structure::SparseStructureCoderOptions& options) {
  options.use_pretrain_branch = false;
  options.freeze_pretrain_branch = false;
}

}  // namespace

SparseStructureAutoEncoderStageOptions SparseStructureAutoEncoderStageOptions::read(ConfigReader& args) {
  SparseStructureAutoEncoderStageOptions options;
  ConfigFields f(args);
  options.loss_type = sparse_structure::occupancy_loss_named(args.choice("loss_type", "bce", {"dice", "bce", "l1"}));
  f("lambda_kl", options.lambda_kl, {0.0});
  f("lambda_kl_skl", options.lambda_kl_skl, {0.0});
  options.noise.fields(f, "");
  options.noise_skl.fields(f, "_skl");
  f("eval_max_assets", options.eval_max_assets, {0});
  options.warm_start = WarmStartOptions::read(args);
  return options;
}

void SparseStructureCoders::validate(const std::string& file) const {
  const auto& e = encoder;
  const auto& d = decoder;
  const std::string pointer = "/models/decoder/args", differs = "differs from the encoder's";
  const OptionCheck check{file, pointer};
  check(e.latent_channels == d.latent_channels, "latent_channels", differs + " " + std::to_string(e.latent_channels));
  check(e.latent_channels_skl == d.latent_channels_skl, "latent_channels_skl",
        differs + " " + std::to_string(e.latent_channels_skl));
  check(e.levels() == d.levels(), "channels",
        "has another number of levels than the encoder's " + std::to_string(e.levels()));
  check(e.encode_global == d.encode_global, "encode_global", differs);
  check(e.encode_global_skl == d.encode_global_skl, "encode_global_skl", differs);
  check(!e.encode_global || e.global_token_num == d.global_token_num, "global_token_num", differs);
  check(!e.encode_global_skl || e.global_token_num_skl == d.global_token_num_skl, "global_token_num_skl", differs);
  for (const auto& [place, channels] : {std::pair{"encoder/args/in_channels", e.in_channels},
                                        {"encoder/args/in_channels_skl", e.in_channels_skl},
                                        {"decoder/args/out_channels", d.out_channels},
                                        {"decoder/args/out_channels_skl", d.out_channels_skl}}) {
    OptionCheck{file, "/models"}(channels == 1, place, "occupancy has one channel, found " + std::to_string(channels));
  }
}

void SparseStructureCoders::require_resolution(std::int64_t resolution, const ConfigReader& dataset_args) const {
  if (resolution % encoder.downsampling() != 0) {
    throw dataset_args.error("resolution", "must be a multiple of " + std::to_string(encoder.downsampling()) +
                                               ", by which the models' channels divide it");
  }
  const bool tokens = encoder.encode_global || encoder.encode_global_skl;
  if (tokens && resolution != sparse_structure::kGlobalTokenResolution) {
    throw dataset_args.error("resolution", "must be " + std::to_string(sparse_structure::kGlobalTokenResolution) +
                                               " for models with encode_global or encode_global_skl");
  }
}

void SparseStructureAutoEncoderStage::warm_start(const LoadedKeys& finetuned) {
  const auto start = [&](torch::nn::Module& model, bool wanted, const char* name, const char* class_name) {
    if (wanted) load_pretrained(model, {PretrainedFile{class_name, ""}}, options_.warm_start, keys_of(finetuned, name));
  };
  start(*encoder_, coders_.encoder.use_pretrain_branch, "encoder", sparse_structure::kSparseStructureEncoderClass);
  start(*decoder_, coders_.decoder.use_pretrain_branch, "decoder", sparse_structure::kSparseStructureDecoderClass);
}

Losses SparseStructureAutoEncoderStage::losses(const data::Batch& batch, const LossContext& context) {
  const auto& grids = dynamic_cast<const data::SparseStructureBatch&>(batch);
  at::Generator generator = loss_generator(context, "sparse structure latents");
  struct StreamLoss {
    Tensor reconstruction, kl;  // kl undefined where the latent gets noise
  };
  const auto stream = [&](bool skeleton) {
    const Tensor occupancy = nn::to_device(skeleton ? grids.ss_skl : grids.ss, device_);
    const std::int64_t items = occupancy.size(0);
    const bool deterministic = skeleton ? coders_.encoder.latent_denoising_skl : coders_.encoder.latent_denoising;
    const LatentDenoising& noise = skeleton ? options_.noise_skl : options_.noise;
    // z = μ + σ ε, or z = μ for an encoder whose latents get noise afterwards.
    Tensor epsilon;
    if (!deterministic)
      epsilon = normal_draws(encoder_->latent_shape(items, occupancy.size(2), skeleton), generator, device_);
    const auto latent =
        skeleton ? encoder_->encode_skeleton(occupancy, epsilon) : encoder_->encode_shape(occupancy, epsilon);
    StreamLoss loss;
    Tensor z = latent.z;
    if (noise.enabled) {  // z_t = (1 − t) z + t γ ε
      const Tensor u = torch::rand({items}, generator, torch::TensorOptions(torch::kFloat32));
      const Tensor t = nn::to_device(latent_times(u, noise.time_max_at(context.step)), device_);
      z = mix_latent_noise(z, normal_draws(z.sizes(), generator, device_), t, noise.gamma);
    } else {  // KL(N(μ, σ²) ‖ N(0, 1))
      loss.kl = sparse_structure::posterior_kl(latent.mean, latent.logvar);
    }
    const Tensor logits = skeleton ? decoder_->decode_skeleton(z) : decoder_->decode_shape(z);
    loss.reconstruction = sparse_structure::occupancy_loss(logits, occupancy, options_.loss_type);
    return loss;
  };
  const StreamLoss shape = stream(false), skeleton = stream(true);
  // L = L_rec + L_rec,skl + λ_kl KL + λ_kl,skl KL_skl
  const std::string name = sparse_structure::name_of(options_.loss_type);
  Losses losses{shape.reconstruction + skeleton.reconstruction,
                {{name, shape.reconstruction}, {name + "_skl", skeleton.reconstruction}}};
  const auto add = [&](const char* term, const Tensor& kl, double lambda) {
    if (!kl.defined()) return;
    losses.total = losses.total + lambda * kl;
    losses.terms.emplace_back(term, kl);
  };
  add("kl", shape.kl, options_.lambda_kl);
  add("kl_skl", skeleton.kl, options_.lambda_kl_skl);
  return losses;
}

SparseStructureAutoEncoderStage::Reconstruction SparseStructureAutoEncoderStage::reconstruct(std::size_t index) {
  const torch::NoGradGuard no_grad;
  const auto batch = held_out_->load({{index, static_cast<std::uint64_t>(index)}});
  const auto& grids = dynamic_cast<const data::SparseStructureBatch&>(*batch);
  Reconstruction made;
  made.id = batch->ids.front();
  made.latents = encoder_->forward(grids.ss.to(device_), grids.ss_skl.to(device_));
  const auto logits = decoder_->forward(made.latents.z, made.latents.z_skl);
  made.truth = {occupied_grid(grids.ss), occupied_grid(grids.ss_skl)};
  made.decoded = {occupied_grid(logits.shape), occupied_grid(logits.skeleton)};
  return made;
}

Values SparseStructureAutoEncoderStage::evaluate() {
  if (!held_out_) return {};
  const std::vector<std::size_t> places = looked_at(held_out_->size(), options_.eval_max_assets);
  Values means{{"iou_shape", 0.0}, {"f1_shape", 0.0}, {"iou_skl", 0.0}, {"f1_skl", 0.0}};
  for (const std::size_t i : places) {
    const Reconstruction made = reconstruct(i);
    const auto shape = sparse_structure::voxel_agreement(made.decoded.shape, made.truth.shape);
    const auto skeleton = sparse_structure::voxel_agreement(made.decoded.skeleton, made.truth.skeleton);
    const double values[] = {shape.iou, shape.f1, skeleton.iou, skeleton.f1};
    for (std::size_t k = 0; k < means.size(); ++k) means[k].second += values[k] / static_cast<double>(places.size());
  }
  return means;
}

std::unique_ptr<Stage> make_sparse_structure_autoencoder_stage(const StageRequest& request) {
  const auto options = SparseStructureAutoEncoderStageOptions::read(request.args);
  ConfigReader top(request.config, request.file);
  auto coders = read_coders<SparseStructureCoders>(top, sparse_structure::kSparseStructureEncoderClass,
                                                   sparse_structure::kSparseStructureDecoderClass);
  if (!options.warm_start.enabled) {
    unfreeze(coders.encoder);
    unfreeze(coders.decoder);
  }
  const data::Datasets data = autoencoder_datasets(top, "AniGenSparseStructure", request.trainer.seed);
  ConfigReader dataset_args = top.object("dataset").object("args");
  coders.require_resolution(dataset_args.integer("resolution", data::SparseStructureOptions().resolution),
                            dataset_args);
  return std::make_unique<SparseStructureAutoEncoderStage>(coders, options, data.train, data.eval, request.device);
}

void SparseStructureAutoEncoderStage::sample(const std::filesystem::path& folder) {
  if (!held_out_ || held_out_->size() == 0) return;
  std::vector<Reconstruction> made;
  std::vector<sparse_structure::VoxelSheetRow> rows;
  for (std::size_t i = 0; i < std::min(kSheetAssets, held_out_->size()); ++i) {
    made.push_back(reconstruct(i));
    const Reconstruction& one = made.back();
    rows.push_back({short_id(one.id), {one.truth, one.decoded}});
  }
  sparse_structure::write_voxel_sheet(folder / "reconstructions.png", rows, {"ground truth", "reconstruction"});

  const torch::NoGradGuard no_grad;
  const sparse_structure::SparseStructureEncoderOptions& coder = coders_.encoder;
  std::vector<sparse_structure::VoxelSheetRow> strips;
  for (std::size_t i = 0; i + 1 < made.size(); i += 2) {
    const auto &a = made[i].latents, &b = made[i + 1].latents;
    sparse_structure::VoxelSheetRow strip{short_id(made[i].id) + " to " + short_id(made[i + 1].id), {}};
    for (int step = 0; step < kBetweenSteps; ++step) {
      const double share = static_cast<double>(step) / (kBetweenSteps - 1);
      const Tensor z = latent_between(a.z, b.z, share, coder.latent_denoising && coder.normalize_z, coder);
      const Tensor z_skl =
          latent_between(a.z_skl, b.z_skl, share, coder.latent_denoising_skl && coder.normalize_z_skl, coder);
      const auto logits = decoder_->forward(z, z_skl);
      strip.cells.push_back({occupied_grid(logits.shape), occupied_grid(logits.skeleton)});
    }
    strips.push_back(std::move(strip));
  }
  if (!strips.empty()) sparse_structure::write_voxel_sheet(folder / "between_latents.png", strips);
}

}  // namespace anigen::train
