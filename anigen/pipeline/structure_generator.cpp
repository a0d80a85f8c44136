#include "anigen/pipeline/structure_generator.h"

#include "anigen/core/config_reader.h"
#include "anigen/core/error.h"
#include "anigen/features/trained_condition_encoder.h"
#include "anigen/loaders/latent_normalization.h"
#include "anigen/models/sparse_structure_sampling.h"
#include "anigen/models/voxel_components.h"
#include "anigen/nn/generator.h"
#include "anigen/pipeline/conditioned_reading.h"
#include "anigen/pipeline/device.h"
#include "anigen/pipeline/run_paths.h"

namespace anigen::pipeline {

using torch::Tensor;

StructureGenerator::StructureGenerator(const Request& request)
    : device_(parse_device(request.device)),
      run_(request.run),
      flow_(models::find_flow_model(request.run, {models::kSparseStructureFlowClass}, request.ckpt, request.averages)),
      autoencoder_(request.autoencoder),
      reading_(
          conditioned_reading<loaders::StructureLatentOptions>(flow_, "ImageConditionedAniGenSparseStructureLatent")) {
  ConfigReader top(flow_.run, flow_.config.string());
  ConfigReader args = top.object("trainer").object("args");
  sampler_ = models::SparseStructureFlowStageOptions::read(args).sampler;
  if (autoencoder_.empty()) {
    autoencoder_ = named_run(run_, reading_.ss_dec_path, flow_.config, "/dataset/args/ss_dec_path");
  }
  model_ = models::load_sparse_structure_flow(flow_, device_);
  if (request.precision != torch::kFloat32) model_->set_compute_dtype(request.precision);
  decoder_ = models::load_sparse_structure_decoder(
      models::find_run_model(autoencoder_, models::kSparseStructureDecoderClass, reading_.ss_dec_ckpt), device_);
}

Tensor StructureGenerator::condition(const Tensor& pictures) {
  const torch::NoGradGuard no_grad;
  if (!encoder_) {
    encoder_ =
        features::trained_condition_encoder(run_, flow_, reading_.image_size, model_->options().cond_channels, device_);
  }
  return encoder_->tokens(pictures);
}

flow::Streams StructureGenerator::noise(std::uint64_t seed, std::uint64_t number) const {
  return noise(nn::numbered_generator(seed, "structure noise", number));
}

flow::Streams StructureGenerator::noise(const at::Generator& generator) const {
  const models::SparseStructureFlowOptions& options = model_->options();
  const std::int64_t r = options.resolution;
  const Tensor shape = torch::randn({1, options.in_channels, r, r, r}, generator);
  const Tensor skeleton = torch::randn({1, options.in_channels_skl, r, r, r}, generator);
  return {shape.to(device_), skeleton.to(device_)};
}

flow::Streams StructureGenerator::sample(const flow::Streams& noise, const Tensor& condition,
                                         const flow::SamplerOptions& sampler, bool guided,
                                         const flow::SamplingExtras& extras) {
  const torch::NoGradGuard no_grad;
  return flow::sample_flow(noise, models::structure_velocities(model_, condition, guided), sampler, extras).samples;
}

flow::Streams StructureGenerator::denormalised(const flow::Streams& latents) const {
  return {loaders::denormalised(latents[0].to(device_), reading_.normalization),
          loaders::denormalised(latents[1].to(device_), reading_.normalization_skl)};
}

models::SparseStructureDecoderImpl::Logits StructureGenerator::logits(const flow::Streams& latents, std::int64_t item) {
  const torch::NoGradGuard no_grad;
  const flow::Streams one = denormalised({latents[0].narrow(0, item, 1), latents[1].narrow(0, item, 1)});
  return decoder_->forward(one[0], one[1]);
}

std::vector<models::VoxelPair> StructureGenerator::decode(const flow::Streams& latents) {
  const torch::NoGradGuard no_grad;
  std::vector<models::VoxelPair> decoded;
  for (std::int64_t i = 0; i < latents[0].size(0); ++i) {  // one by one: a batch of 64³ volumes is large
    const auto logits = this->logits(latents, i);
    const auto occupied = [](const Tensor& grid) { return (grid[0][0] > 0).to(torch::kCPU).contiguous(); };
    decoded.push_back({occupied(logits.shape), models::largest_component(occupied(logits.skeleton))});
  }
  return decoded;
}

}  // namespace anigen::pipeline
