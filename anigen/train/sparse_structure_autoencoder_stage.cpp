#include "anigen/train/sparse_structure_autoencoder_stage.h"

#include <algorithm>

#include "anigen/loaders/datasets/sparse_structure_dataset.h"
#include "anigen/models/sparse_structure_runs.h"
#include "anigen/models/voxel_metrics.h"
#include "anigen/train/loss_generator.h"

namespace anigen::train {
namespace {

using torch::Tensor;

Tensor normal_draws(const std::vector<std::int64_t>& shape, at::Generator& generator, torch::Device device) {
  return torch::randn(shape, generator, torch::TensorOptions(torch::kFloat32)).to(device);
}

// What one stream of one micro-batch adds to the loss.
struct StreamLoss {
  Tensor reconstruction, kl;  // kl undefined where the latent gets noise
};

// [1, 1, R, R, R] logits or counts → bool [R, R, R] on the CPU.
Tensor occupied_grid(const Tensor& values) { return (values[0][0] > 0).to(torch::kCPU); }

void add_mean(Values& means, const std::string& name, double value, std::size_t count) {
  const double part = value / static_cast<double>(count);
  for (auto& entry : means) {
    if (entry.first == name) {
      entry.second += part;
      return;
    }
  }
  means.emplace_back(name, part);
}

}  // namespace

SparseStructureAutoEncoderStageOptions SparseStructureAutoEncoderStageOptions::read(ConfigReader& args) {
  SparseStructureAutoEncoderStageOptions options;
  options.loss_type = models::occupancy_loss_named(args.choice("loss_type", "bce", {"dice", "bce", "l1"}));
  options.lambda_kl = args.number("lambda_kl", options.lambda_kl, 0.0);
  options.lambda_kl_skl = args.number("lambda_kl_skl", options.lambda_kl_skl, 0.0);
  options.noise = LatentDenoising::read(args, "");
  options.noise_skl = LatentDenoising::read(args, "_skl");
  options.eval_max_assets = args.integer("eval_max_assets", 0, 0);
  options.warm_start = WarmStartOptions::read(args);
  return options;
}

SparseStructureAutoEncoderStage::SparseStructureAutoEncoderStage(const SparseStructureCoders& coders,
                                                                 const SparseStructureAutoEncoderStageOptions& options,
                                                                 Dataset data, Dataset held_out, torch::Device device,
                                                                 nn::Init init)
    : coders_(coders),
      options_(options),
      data_(std::move(data)),
      held_out_(std::move(held_out)),
      device_(device),
      encoder_(coders.encoder, init),
      decoder_(coders.decoder, init) {
  encoder_->to(device_);
  decoder_->to(device_);
}

std::unique_ptr<Stage> SparseStructureAutoEncoderStage::replica() const {
  auto twin =
      std::make_unique<SparseStructureAutoEncoderStage>(coders_, options_, data_, held_out_, device_, nn::Init::kNone);
  share_frozen_weights(*encoder_, *twin->encoder_);
  share_frozen_weights(*decoder_, *twin->decoder_);
  return twin;
}

void SparseStructureAutoEncoderStage::warm_start(const LoadedKeys& finetuned) {
  const auto start = [&](torch::nn::Module& model, bool wanted, const char* name, const char* class_name) {
    if (wanted) load_pretrained(model, {PretrainedFile{class_name, ""}}, options_.warm_start, keys_of(finetuned, name));
  };
  start(*encoder_, coders_.encoder.use_pretrain_branch, "encoder", models::kSparseStructureEncoderClass);
  start(*decoder_, coders_.decoder.use_pretrain_branch, "decoder", models::kSparseStructureDecoderClass);
}

void SparseStructureAutoEncoderStage::set_compute_dtype(torch::Dtype dtype) {
  encoder_->set_torso_dtype(dtype);
  decoder_->set_torso_dtype(dtype);
}

Losses SparseStructureAutoEncoderStage::losses(const loaders::Batch& batch, const LossContext& context) {
  const auto& grids = dynamic_cast<const loaders::SparseStructureBatch&>(batch);
  at::Generator generator = loss_generator(context, "sparse structure latents");
  const auto stream = [&](bool skeleton) {
    const Tensor occupancy = (skeleton ? grids.ss_skl : grids.ss).to(device_);
    const std::int64_t items = occupancy.size(0);
    const bool deterministic = skeleton ? coders_.encoder.latent_denoising_skl : coders_.encoder.latent_denoising;
    const LatentDenoising& noise = skeleton ? options_.noise_skl : options_.noise;
    Tensor posterior_noise;
    if (!deterministic) {
      posterior_noise = normal_draws(encoder_->latent_shape(items, occupancy.size(2), skeleton), generator, device_);
    }
    const auto latent = skeleton ? encoder_->encode_skeleton(occupancy, posterior_noise)
                                 : encoder_->encode_shape(occupancy, posterior_noise);
    StreamLoss loss;
    Tensor z = latent.z;
    if (noise.enabled) {
      const Tensor u = torch::rand({items}, generator, torch::TensorOptions(torch::kFloat32)).to(device_);
      const Tensor times = latent_times(u, noise.time_max_at(context.step));
      z = mix_latent_noise(z, normal_draws(z.sizes().vec(), generator, device_), times, noise.gamma);
    } else {
      loss.kl = models::posterior_kl(latent.mean, latent.logvar);
    }
    const Tensor logits = skeleton ? decoder_->decode_skeleton(z) : decoder_->decode_shape(z);
    loss.reconstruction = models::occupancy_loss(logits, occupancy, options_.loss_type);
    return loss;
  };
  const StreamLoss shape = stream(false), skeleton = stream(true);
  const std::string name = models::name_of(options_.loss_type);
  Losses losses{shape.reconstruction + skeleton.reconstruction,
                {{name, shape.reconstruction}, {name + "_skl", skeleton.reconstruction}}};
  if (shape.kl.defined()) {
    losses.total = losses.total + options_.lambda_kl * shape.kl;
    losses.terms.emplace_back("kl", shape.kl);
  }
  if (skeleton.kl.defined()) {
    losses.total = losses.total + options_.lambda_kl_skl * skeleton.kl;
    losses.terms.emplace_back("kl_skl", skeleton.kl);
  }
  return losses;
}

SparseStructureAutoEncoderStage::Reconstruction SparseStructureAutoEncoderStage::reconstruct(std::size_t index) {
  const torch::NoGradGuard no_grad;
  const auto batch = held_out_->load({{index, static_cast<std::uint64_t>(index)}});
  const auto& grids = dynamic_cast<const loaders::SparseStructureBatch&>(*batch);
  Reconstruction made;
  made.id = batch->ids.front();
  made.latents = encoder_->forward(grids.ss.to(device_), grids.ss_skl.to(device_));
  const auto logits = decoder_->forward(made.latents.z, made.latents.z_skl);
  made.shape = occupied_grid(grids.ss);
  made.skeleton = occupied_grid(grids.ss_skl);
  made.decoded_shape = occupied_grid(logits.shape);
  made.decoded_skeleton = occupied_grid(logits.skeleton);
  return made;
}

Values SparseStructureAutoEncoderStage::evaluate() {
  if (!held_out_) return {};
  const auto most = static_cast<std::size_t>(options_.eval_max_assets);
  const std::size_t count = most == 0 ? held_out_->size() : std::min(most, held_out_->size());
  Values means;
  for (std::size_t i = 0; i < count; ++i) {
    const Reconstruction made = reconstruct(i);
    const models::VoxelAgreement shape = models::voxel_agreement(made.decoded_shape, made.shape);
    const models::VoxelAgreement skeleton = models::voxel_agreement(made.decoded_skeleton, made.skeleton);
    add_mean(means, "iou_shape", shape.iou, count);
    add_mean(means, "f1_shape", shape.f1, count);
    add_mean(means, "iou_skl", skeleton.iou, count);
    add_mean(means, "f1_skl", skeleton.f1, count);
  }
  return means;
}

}  // namespace anigen::train
