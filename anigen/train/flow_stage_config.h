#pragma once
#include <memory>
#include <optional>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "anigen/core/log.h"
#include "anigen/features/condition_encoder.h"
#include "anigen/loaders/datasets/dataset_registry.h"
#include "anigen/loaders/files/view_files.h"
#include "anigen/models/run_model.h"
#include "anigen/train/trainer_options.h"
#include "anigen/train/warm_start.h"

namespace anigen::train {

/// What the config of a flow stage calls its parts.
struct FlowConfigNames {
  std::vector<std::string> model_classes;
  const char* conditioned_trainer;  ///< the one that needs pictures
  const char* conditioned_dataset;
  const char* plain_dataset;
};

/// The run of an auto-encoder that the dataset's arguments name to decode samples; none when no samples are drawn or
/// none is named. @param key `…_dec_path`, for messages @throws InputError when there is no such run
std::optional<models::RunModel> samples_decoder(const std::string& path, const std::string& ckpt,
                                                const std::string& class_name, const std::string& key,
                                                const TrainerOptions& trainer);

/// A dataset of this class that is conditioned as the trainer needs it; null for null. @throws InputError
template <typename DatasetType>
std::shared_ptr<const DatasetType> latent_dataset(const std::shared_ptr<const loaders::BatchSource>& source,
                                                  const ConfigReader& dataset, bool conditioned,
                                                  const FlowConfigNames& names) {
  if (!source) return nullptr;
  const auto latents = std::dynamic_pointer_cast<const DatasetType>(source);
  if (latents && latents->options().image_conditioned == conditioned) return latents;
  throw dataset.error("name", std::string("this trainer needs the dataset ") +
                                  (conditioned ? names.conditioned_dataset : names.plain_dataset));
}

/// The one flow model of a config. @param start not enabled: nothing is frozen
template <typename Model>
Model flow_model(ConfigReader& models, const std::string& name, const std::vector<std::string>& classes,
                 const WarmStartOptions& start) {
  using Options = std::decay_t<decltype(std::declval<Model>()->options())>;
  ConfigReader model = models.object(name);
  model.require("name");
  model.choice("name", "", classes);
  Options options = Options::from_json(model.raw("args") ? *model.raw("args") : Json::object(), model.file(),
                                       model.pointer_to("args"));
  model.finish();
  if (!start.enabled) options.use_pretrain_branch = options.freeze_pretrain_branch = false;
  return Model(options);
}

/// The parts of a flow stage but its decoder. @throws InputError naming file and JSON pointer
template <typename StageType>
typename StageType::Parts flow_parts(const Json& config, const std::string& file, ConfigReader& trainer_args,
                                     const TrainerOptions& trainer, torch::Device device,
                                     const FlowConfigNames& names) {
  using DatasetType = std::remove_const_t<typename StageType::Dataset::element_type>;
  ConfigReader top(config, file);
  const bool conditioned = top.object("trainer").text("name", "") == names.conditioned_trainer;
  top.require("models");
  ConfigReader models = top.object("models");
  const Json& list = *top.raw("models");
  if (list.size() != 1) throw models.error("", "this stage trains exactly one model");
  typename StageType::Parts parts;
  parts.name = list.begin().key();
  parts.device = device;
  parts.start = WarmStartOptions::read(trainer_args);
  parts.model = flow_model<typename StageType::ModelType>(models, parts.name, names.model_classes, parts.start);
  parts.model->to(device);

  const ConfigReader dataset = top.object("dataset");
  const loaders::Datasets datasets = loaders::make_datasets(dataset, trainer.seed);
  parts.data = latent_dataset<DatasetType>(datasets.train, dataset, conditioned, names);
  parts.held_out = latent_dataset<DatasetType>(datasets.eval, dataset, conditioned, names);
  log::info("{} assets to train on, {} held out", parts.data->assets(), parts.held_out ? parts.held_out->assets() : 0);
  if (conditioned) {
    const auto& reading = parts.data->options();
    const bool normals = reading.condition == loaders::ConditionPictures::kNormals;
    log::info("conditioned on pictures of {}", normals ? "normals" : "colour");
    parts.encoder = features::make_condition_encoder(trainer_args, reading.image_size,
                                                     parts.model->options().cond_channels, device);
  }
  return parts;
}

}  // namespace anigen::train
