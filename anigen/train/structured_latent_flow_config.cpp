#include "anigen/core/error.h"
#include "anigen/models/structured_latent_flow_runs.h"
#include "anigen/models/structured_latent_runs.h"
#include "anigen/train/flow_stage_config.h"
#include "anigen/train/structured_latent_flow_stage.h"

// From a config to the stage; what the stage does is in structured_latent_flow_stage.cpp.
namespace anigen::train {
namespace {

const FlowConfigNames& structured_latent_names() {
  static const FlowConfigNames names{{models::kStructuredLatentFlowClass, models::kPlainStructuredLatentFlowClass},
                                     "AniGenImageConditionedSparseFlowMatchingCFGTrainer",
                                     "AniGenImageConditionedSLat",
                                     "AniGenSLat"};
  return names;
}

// Says that two numbers of channels should be one.
void require_channels(std::int64_t wanted, std::int64_t found, const InputError& problem) {
  if (wanted != found) throw problem;
}

void check_stream(const models::StructuredLatentFlowStreamOptions& stream, const std::string& suffix,
                  const std::string& file, const std::string& pointer) {
  require_channels(
      stream.in_channels, stream.out_channels,
      InputError(file, pointer + "/out_channels" + suffix,
                 "a velocity has the channels of the latent: expected in_channels" + suffix + ", " +
                     std::to_string(stream.in_channels) + ", found " + std::to_string(stream.out_channels)));
}

// Whether model and dataset fit is known before a run folder is touched: from the first asset.
void check_latents(const models::StructuredLatentFlowOptions& model, const loaders::StructuredLatentDataset& data,
                   const std::string& file, const std::string& pointer) {
  const auto batch = data.load({loaders::Draw{0, 0}});
  const auto& latents = dynamic_cast<const loaders::StructuredLatentBatch&>(*batch);
  const std::int64_t shape = latents.x_0.feats.size(1), skeleton = latents.x_0_skl.feats.size(1);
  require_channels(model.geometry.in_channels + model.skin.in_channels, shape,
                   InputError(file, pointer + "/in_channels",
                              "with in_channels_vert_skin makes " +
                                  std::to_string(model.geometry.in_channels + model.skin.in_channels) +
                                  " channels, but the dataset's latents have " + std::to_string(shape)));
  require_channels(model.skeleton.in_channels, skeleton,
                   InputError(file, pointer + "/in_channels_skl",
                              std::to_string(model.skeleton.in_channels) +
                                  ", but the dataset's skeleton latents have " + std::to_string(skeleton)));
}

void check_decoder(const models::StructuredLatentFlowOptions& model,
                   const models::StructuredLatentDecoderOptions& decoder, const models::RunModel& run) {
  const auto check = [&](std::int64_t wanted, std::int64_t found, const char* key) {
    require_channels(wanted, found,
                     InputError(run.config.string(), run.pointer + "/" + key,
                                std::to_string(found) + ", but the flow's latents have " + std::to_string(wanted)));
  };
  check(model.geometry.in_channels, decoder.latent_channels, "latent_channels");
  check(model.skin.in_channels, decoder.latent_channels_vertskin, "latent_channels_vertskin");
  check(model.skeleton.in_channels, decoder.latent_channels_skl, "latent_channels_skl");
}

// Three switches of the same name: the trainer's needs the other two.
void check_joint_counts(const models::StructuredLatentFlowOptions& model,
                        const loaders::StructuredLatentOptions& reading,
                        const models::StructuredLatentFlowStageOptions& options, const ConfigReader& trainer_args) {
  constexpr const char* kSwitch = "use_joint_num_cond";
  if (options.use_joint_num_cond && !model.use_joint_num_cond) {
    throw trainer_args.error(kSwitch, "needs the model's use_joint_num_cond");
  }
  if (options.use_joint_num_cond && !reading.use_joint_num_cond) {
    throw trainer_args.error(kSwitch, "needs the dataset's use_joint_num_cond");
  }
  if (model.use_joint_num_cond && !options.use_joint_num_cond) {
    log::warn("the model takes numbers of joints, but without trainer.args.{} it will be told none", kSwitch);
  }
}

}  // namespace

std::unique_ptr<Stage> make_structured_latent_flow_stage(const Json& config, const std::string& file,
                                                         ConfigReader& trainer_args, const TrainerOptions& trainer,
                                                         torch::Device device) {
  models::StructuredLatentFlowStageOptions options = models::StructuredLatentFlowStageOptions::read(trainer_args);
  options.seed = trainer.seed;
  auto parts =
      flow_parts<StructuredLatentFlowStage>(config, file, trainer_args, trainer, device, structured_latent_names());
  const models::StructuredLatentFlowOptions& model = parts.model->options();
  const std::string pointer = "/models/" + escaped_for_pointer(parts.name) + "/args";
  check_stream(model.geometry, "", file, pointer);
  check_stream(model.skin, "_vert_skin", file, pointer);
  check_stream(model.skeleton, "_skl", file, pointer);
  const loaders::StructuredLatentOptions& reading = parts.data->options();
  check_joint_counts(model, reading, options, trainer_args);
  check_latents(model, *parts.data, file, pointer);
  if (const auto decoder = samples_decoder(reading.slat_dec_path, reading.slat_dec_ckpt,
                                           models::kStructuredLatentDecoderClass, "slat_dec_path", trainer)) {
    parts.decoder = models::load_rig_decoder(*decoder, device);
    check_decoder(model, parts.decoder->options(), *decoder);
  }
  return std::make_unique<StructuredLatentFlowStage>(options, std::move(parts));
}

}  // namespace anigen::train
