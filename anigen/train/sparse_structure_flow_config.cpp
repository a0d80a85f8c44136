#include "anigen/core/error.h"
#include "anigen/core/log.h"
#include "anigen/loaders/datasets/dataset_registry.h"
#include "anigen/models/sparse_structure_runs.h"
#include "anigen/train/sparse_structure_flow_stage.h"

// From a config to the stage; what the stage does is in sparse_structure_flow_stage.cpp.
namespace anigen::train {
namespace {

constexpr const char* kConditionedTrainer = "AniGenImageConditionedFlowMatchingCFGTrainer";

SparseStructureFlowStage::Dataset structure_latents(const std::shared_ptr<const loaders::BatchSource>& source,
                                                    const ConfigReader& dataset, bool conditioned) {
  if (!source) return nullptr;
  const auto latents = std::dynamic_pointer_cast<const loaders::StructureLatentDataset>(source);
  if (latents && latents->options().image_conditioned == conditioned) return latents;
  throw dataset.error(
      "name", std::string("this trainer needs the dataset ") +
                  (conditioned ? "ImageConditionedAniGenSparseStructureLatent" : "AniGenSparseStructureLatent"));
}

models::SparseStructureFlow flow_model(ConfigReader& models, const std::string& name, const WarmStartOptions& start) {
  ConfigReader model = models.object(name);
  model.require("name");
  model.choice("name", "", {models::kSparseStructureFlowClass});
  auto options = models::SparseStructureFlowOptions::from_json(model.raw("args") ? *model.raw("args") : Json::object(),
                                                               model.file(), model.pointer_to("args"));
  model.finish();
  if (!start.enabled) options.use_pretrain_branch = options.freeze_pretrain_branch = false;
  return models::SparseStructureFlow(options);
}

/// Of the stage-2 run that the dataset's arguments name; only samples need it.
models::SparseStructureDecoder decoder_of(const loaders::StructureLatentOptions& data, const TrainerOptions& trainer,
                                          torch::Device device) {
  if (trainer.i_sample <= 0) return nullptr;
  if (data.ss_dec_path.empty()) {
    log::info("dataset.args.ss_dec_path names no stage-2 run: no samples will be drawn");
    return nullptr;
  }
  const models::RunModel found =
      models::find_run_model(data.ss_dec_path, models::kSparseStructureDecoderClass, data.ss_dec_ckpt);
  log::info("samples are decoded by {}", found.checkpoint.string());
  return models::load_sparse_structure_decoder(found, device);
}

}  // namespace

std::unique_ptr<Stage> make_sparse_structure_flow_stage(const Json& config, const std::string& file,
                                                        ConfigReader& trainer_args, const TrainerOptions& trainer,
                                                        torch::Device device) {
  SparseStructureFlowStageOptions options = SparseStructureFlowStageOptions::read(trainer_args);
  options.seed = trainer.seed;
  ConfigReader top(config, file);
  const bool conditioned = top.object("trainer").text("name", "") == kConditionedTrainer;

  top.require("models");
  ConfigReader models = top.object("models");
  const Json& list = *top.raw("models");
  if (list.size() != 1) throw models.error("", "this stage trains exactly one model");
  SparseStructureFlowStage::Parts parts;
  parts.name = list.begin().key();
  parts.device = device;
  parts.start = WarmStartOptions::read(trainer_args);
  parts.model = flow_model(models, parts.name, parts.start);
  parts.model->to(device);

  const ConfigReader dataset = top.object("dataset");
  const loaders::Datasets datasets = loaders::make_datasets(dataset, trainer.seed);
  parts.data = structure_latents(datasets.train, dataset, conditioned);
  parts.held_out = structure_latents(datasets.eval, dataset, conditioned);
  const loaders::StructureLatentOptions& reading = parts.data->options();
  log::info("{} assets to train on, {} held out", parts.data->assets(), parts.held_out ? parts.held_out->assets() : 0);
  if (conditioned) {
    const bool normals = reading.condition == loaders::ConditionPictures::kNormals;
    log::info("conditioned on pictures of {}", normals ? "normals" : "colour");
    parts.encoder =
        make_condition_encoder(trainer_args, reading.image_size, parts.model->options().cond_channels, device);
  }
  parts.decoder = decoder_of(reading, trainer, device);
  return std::make_unique<SparseStructureFlowStage>(options, std::move(parts));
}

}  // namespace anigen::train
