// From a config to the stage of the sparse-structure auto-encoder.
#include "anigen/core/error.h"
#include "anigen/core/log.h"
#include "anigen/loaders/datasets/dataset_registry.h"
#include "anigen/loaders/datasets/sparse_structure_dataset.h"
#include "anigen/models/sparse_structure_runs.h"
#include "anigen/train/sparse_structure_autoencoder_stage.h"

namespace anigen::train {
namespace {

template <typename Options>
Options read_coder(ConfigReader& models, const std::string& name, const std::string& class_name) {
  models.require(name);
  ConfigReader model = models.object(name);
  model.require("name");
  model.choice("name", "", {class_name});
  const Json* args = model.raw("args");
  const Options options =
      Options::from_json(args != nullptr ? *args : Json::object(), models.file(), model.pointer_to("args"));
  model.finish();
  return options;
}

void require_one_channel(std::int64_t channels, const std::string& file, const char* argument) {
  if (channels == 1) return;
  throw InputError(file, std::string("/models/") + argument,
                   "occupancy has one channel, found " + std::to_string(channels));
}

void require_fit(bool fits, const std::string& file, const std::string& key, const std::string& problem) {
  if (!fits) throw InputError(file, "/models/decoder/args/" + key, problem);
}

void unfreeze(models::SparseStructureCoderOptions& options) {
  options.use_pretrain_branch = false;
  options.freeze_pretrain_branch = false;
}

}  // namespace

void SparseStructureCoders::validate(const std::string& file) const {
  require_fit(encoder.latent_channels == decoder.latent_channels, file, "latent_channels",
              "differs from the encoder's " + std::to_string(encoder.latent_channels));
  require_fit(encoder.latent_channels_skl == decoder.latent_channels_skl, file, "latent_channels_skl",
              "differs from the encoder's " + std::to_string(encoder.latent_channels_skl));
  require_fit(encoder.levels() == decoder.levels(), file, "channels",
              "has another number of levels than the encoder's " + std::to_string(encoder.levels()));
  require_fit(encoder.encode_global == decoder.encode_global, file, "encode_global", "differs from the encoder's");
  require_fit(encoder.encode_global_skl == decoder.encode_global_skl, file, "encode_global_skl",
              "differs from the encoder's");
  require_fit(!encoder.encode_global || encoder.global_token_num == decoder.global_token_num, file, "global_token_num",
              "differs from the encoder's");
  require_fit(!encoder.encode_global_skl || encoder.global_token_num_skl == decoder.global_token_num_skl, file,
              "global_token_num_skl", "differs from the encoder's");
  require_one_channel(encoder.in_channels, file, "encoder/args/in_channels");
  require_one_channel(encoder.in_channels_skl, file, "encoder/args/in_channels_skl");
  require_one_channel(decoder.out_channels, file, "decoder/args/out_channels");
  require_one_channel(decoder.out_channels_skl, file, "decoder/args/out_channels_skl");
}

void SparseStructureCoders::require_resolution(std::int64_t resolution, const ConfigReader& dataset_args) const {
  if (resolution % encoder.downsampling() != 0) {
    throw dataset_args.error("resolution", "must be a multiple of " + std::to_string(encoder.downsampling()) +
                                               ", by which the models' channels divide it");
  }
  const bool tokens = encoder.encode_global || encoder.encode_global_skl;
  if (tokens && resolution != models::kGlobalTokenResolution) {
    throw dataset_args.error("resolution", "must be " + std::to_string(models::kGlobalTokenResolution) +
                                               " for models with encode_global or encode_global_skl");
  }
}

std::unique_ptr<Stage> make_sparse_structure_autoencoder_stage(const Json& config, const std::string& file,
                                                               ConfigReader& trainer_args,
                                                               const TrainerOptions& trainer, torch::Device device) {
  const auto options = SparseStructureAutoEncoderStageOptions::read(trainer_args);
  ConfigReader top(config, file);
  ConfigReader models = top.object("models");
  SparseStructureCoders coders;
  coders.encoder =
      read_coder<models::SparseStructureEncoderOptions>(models, "encoder", models::kSparseStructureEncoderClass);
  coders.decoder =
      read_coder<models::SparseStructureDecoderOptions>(models, "decoder", models::kSparseStructureDecoderClass);
  models.finish();
  coders.validate(file);
  if (!options.warm_start.enabled) {
    unfreeze(coders.encoder);
    unfreeze(coders.decoder);
  }

  ConfigReader dataset = top.object("dataset");
  dataset.require("name");
  dataset.choice("name", "", {"AniGenSparseStructure"});
  const loaders::Datasets data = loaders::make_datasets(top.object("dataset"), trainer.seed);
  ConfigReader dataset_args = dataset.object("args");
  coders.require_resolution(dataset_args.integer("resolution", loaders::SparseStructureOptions().resolution),
                            dataset_args);
  log::info("{} samples an epoch to train on, {} assets held out", data.train->size(),
            data.eval ? data.eval->size() : 0);
  return std::make_unique<SparseStructureAutoEncoderStage>(coders, options, data.train, data.eval, device);
}

}  // namespace anigen::train
