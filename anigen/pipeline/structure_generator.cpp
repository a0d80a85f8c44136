#include "anigen/pipeline/structure_generator.h"

#include "anigen/core/config_reader.h"
#include "anigen/core/error.h"
#include "anigen/io/torch_archive.h"
#include "anigen/models/state_dict.h"
#include "anigen/models/voxel_components.h"
#include "anigen/pipeline/device.h"
#include "anigen/train/loss_generator.h"
#include "anigen/train/sparse_structure_flow_stage.h"

namespace anigen::pipeline {
namespace {

namespace fs = std::filesystem;
using torch::Tensor;

constexpr const char* kConditionedDataset = "ImageConditionedAniGenSparseStructureLatent";

loaders::StructureLatentOptions conditioned_reading(const models::RunModel& flow) {
  ConfigReader top(flow.run, flow.config.string());
  ConfigReader dataset = top.object("dataset");
  dataset.require("name");
  if (dataset.text("name", "") != kConditionedDataset) {
    throw dataset.error("name",
                        std::string("this flow was trained without pictures; they come from ") + kConditionedDataset);
  }
  ConfigReader args = dataset.object("args");
  return loaders::StructureLatentOptions::read(args, true);
}

/// What makes tokens of pictures, with the weights it was trained to beside the flow.
std::unique_ptr<train::ConditionEncoder> trained_condition_encoder(const fs::path& run, ConfigReader& trainer_args,
                                                                   std::int64_t image_size, std::int64_t channels,
                                                                   torch::Device device) {
  auto encoder = train::make_condition_encoder(trainer_args, image_size, channels, device);
  const std::optional<train::NamedModel> trained = encoder->trained();
  if (!trained) return encoder;
  const fs::path weights = models::newest_checkpoint(run, trained->name);
  models::load_state_dict(*trained->module, io::read_state_dict(weights), models::LoadMode::kStrict, weights.string());
  trained->module->eval();
  return encoder;
}

}  // namespace

StructureGenerator::StructureGenerator(const Request& request)
    : device_(parse_device(request.device)),
      flow_(models::find_run_model(request.run, models::kSparseStructureFlowClass, request.ckpt)),
      autoencoder_(request.autoencoder),
      reading_(conditioned_reading(flow_)) {
  ConfigReader top(flow_.run, flow_.config.string());
  ConfigReader args = top.object("trainer").object("args");
  sampler_ = train::SparseStructureFlowStageOptions::read(args).sampler;
  if (autoencoder_.empty()) autoencoder_ = reading_.ss_dec_path;
  if (autoencoder_.empty()) {
    throw InputError(flow_.config.string(), "/dataset/args/ss_dec_path", "names no run of stage 2 to decode with");
  }
  model_ = models::load_sparse_structure_flow(flow_, device_);
  encoder_ =
      trained_condition_encoder(request.run, args, reading_.image_size, model_->options().cond_channels, device_);
  decoder_ = models::load_sparse_structure_decoder(
      models::find_run_model(autoencoder_, models::kSparseStructureDecoderClass, reading_.ss_dec_ckpt), device_);
}

Tensor StructureGenerator::condition(const Tensor& pictures) {
  const torch::NoGradGuard no_grad;
  return encoder_->tokens(pictures);
}

flow::Streams StructureGenerator::noise(std::uint64_t seed, std::uint64_t number) const {
  const models::SparseStructureFlowOptions& options = model_->options();
  const std::int64_t r = options.resolution;
  const at::Generator generator = train::numbered_generator(seed, "structure noise", number);
  const Tensor shape = torch::randn({1, options.in_channels, r, r, r}, generator);
  const Tensor skeleton = torch::randn({1, options.in_channels_skl, r, r, r}, generator);
  return {shape.to(device_), skeleton.to(device_)};
}

flow::Streams StructureGenerator::sample(const flow::Streams& noise, const Tensor& condition,
                                         const flow::SamplerOptions& sampler, bool guided) {
  const torch::NoGradGuard no_grad;
  return flow::sample_euler(noise, train::structure_velocities(model_, condition, guided), sampler).samples;
}

std::vector<train::VoxelPair> StructureGenerator::decode(const flow::Streams& latents) {
  const torch::NoGradGuard no_grad;
  std::vector<train::VoxelPair> decoded;
  for (std::int64_t i = 0; i < latents[0].size(0); ++i) {  // one by one: a batch of 64³ volumes is large
    const auto logits =
        decoder_->forward(train::denormalised(latents[0].narrow(0, i, 1).to(device_), reading_.normalization),
                          train::denormalised(latents[1].narrow(0, i, 1).to(device_), reading_.normalization_skl));
    const auto occupied = [](const Tensor& grid) { return (grid[0][0] > 0).to(torch::kCPU).contiguous(); };
    decoded.push_back({occupied(logits.shape), models::largest_component(occupied(logits.skeleton))});
  }
  return decoded;
}

}  // namespace anigen::pipeline
