#pragma once
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "anigen/core/config.h"
#include "anigen/core/log.h"
#include "anigen/data/datasets.h"
#include "anigen/data/view_files.h"
#include "anigen/data/voxel_files.h"
#include "anigen/flow/matching.h"
#include "anigen/flow/sampler.h"
#include "anigen/nn/init.h"
#include "anigen/nn/state_dict.h"
#include "anigen/nn/torch.h"
#include "anigen/sparse/support.h"
#include "anigen/train/options.h"
#include "anigen/train/stage.h"
#include "anigen/train/warm_start.h"
#include "anigen/vision/condition.h"

namespace anigen::train {

/// Noise that an auto-encoder's trainer mixes into a latent before it is decoded, so that the decoder learns to clean
/// it (paper 3.3; reference training-and-data.md, 3.2).
struct LatentDenoising {
  bool enabled = false;
  double gamma = 1.0;           ///< size of the noise
  double time_max = 0.5;        ///< largest share of noise
  std::int64_t ramp_steps = 0;  ///< steps over which time_max is reached; 0: at once

  /// `latent_denoising`, `latent_denoising_gamma`, `latent_time_max` and `latent_achive_max_step` (spelled so in
  /// published configs), each with `suffix` ("", "_skl") appended.
  static LatentDenoising read(ConfigReader& trainer_args, const std::string& suffix);

  /// Largest share of noise at a step: min(1, step / ramp_steps) · time_max.
  double time_max_at(std::int64_t step) const;
};

/// Lower bound of 1 − u; the published trainers differ.
inline constexpr double kDenseTimeCut = 1e-8, kSparseTimeCut = 1e-10;

/// Shares of noise (1 − √max(1 − u, cut)) · time_max, whose density falls linearly to 0 at time_max.
/// @param u uniform in [0, 1), one per item @return the shape of u
torch::Tensor latent_times(const torch::Tensor& u, double time_max, double cut = kDenseTimeCut);

/// (1 − t) z + t γ noise. @param z [N, …] @param noise the same shape @param times [N], one per row of z: for a sparse
/// latent those of its items gathered by batch index
torch::Tensor mix_latent_noise(const torch::Tensor& z, const torch::Tensor& noise, const torch::Tensor& times,
                               double gamma);

/// Voxels of a batch for the sparse models: features on the device, places where they are.
/// @throws InputError for a voxel that an asset has twice
inline sparse::SparseTensor sparse_of(const data::RaggedVoxels& voxels, torch::Device device) {
  const auto items = static_cast<std::int64_t>(voxels.lengths.size());
  return {sparse::Support::create(voxels.coords, items), voxels.feats.to(device)};
}

/// Names of the parts of a flow stage in its config.
struct FlowConfigNames {
  std::vector<std::string> model_classes;
  const char* conditioned_trainer;  ///< the one that needs pictures
  const char* conditioned_dataset;
  const char* plain_dataset;
};

/// The run of an auto-encoder that the dataset's arguments name to decode samples; none when no samples are drawn or
/// none is named. @param key `…_dec_path`, for messages @throws InputError when there is no such run
std::optional<nn::RunModel> samples_decoder(const std::string& path, const std::string& ckpt,
                                            const std::string& class_name, const std::string& key,
                                            const TrainerOptions& trainer);

/// A dataset of this class that is conditioned as the trainer needs it; null for null. @throws InputError
template <typename DatasetType>
std::shared_ptr<const DatasetType> latent_dataset(const std::shared_ptr<const data::BatchSource>& source,
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
  const data::Datasets datasets = data::make_datasets(dataset, trainer.seed);
  parts.data = latent_dataset<DatasetType>(datasets.train, dataset, conditioned, names);
  parts.held_out = latent_dataset<DatasetType>(datasets.eval, dataset, conditioned, names);
  log::info("{} assets to train on, {} held out", parts.data->assets(), parts.held_out ? parts.held_out->assets() : 0);
  if (conditioned) {
    const auto& reading = parts.data->options();
    const bool normals = reading.condition == data::ConditionPictures::kNormals;
    log::info("conditioned on pictures of {}", normals ? "normals" : "colour");
    parts.encoder =
        vision::make_condition_encoder(trainer_args, reading.image_size, parts.model->options().cond_channels, device);
  }
  return parts;
}

/// Logs the means of per-item errors over the tenths of the time axis that a micro-batch has items in, as
/// "bin_0.<name>" … "bin_9.<name>"; an empty tenth has no mean. @param errors, t [B]
void add_time_bins(Losses& losses, const std::string& name, const torch::Tensor& errors, const torch::Tensor& t);

/// Base of the stages of both flows: one flow model, perhaps with an encoder of condition pictures that is
/// trained beside it, over a dataset of latents (reference training-and-data.md, 3.4).
/// @tparam Model a module holder with options(), set_compute_dtype() and a constructor (options, init)
template <typename Model, typename DatasetType, typename Decoder>
class FlowStage : public Stage {
 public:
  using ModelType = Model;
  using Dataset = std::shared_ptr<const DatasetType>;

  /// Parts of a stage. Replicas share the datasets and the decoder.
  struct Parts {
    std::string name = "denoiser";  ///< of the model, in the config and in checkpoints
    Model model = nullptr;
    std::unique_ptr<vision::ConditionEncoder> encoder;  ///< null: not conditioned, the flow sees one token of zeros
    Dataset data, held_out;                             ///< held_out may be null
    Decoder decoder = nullptr;                          ///< of the latents, for sample(); null: no samples
    torch::Device device = torch::kCPU;
    WarmStartOptions start;
  };

  std::vector<nn::NamedModel> models() const override {
    std::vector<nn::NamedModel> all{{parts_.name, parts_.model.ptr()}};
    if (parts_.encoder) {
      if (const std::optional<nn::NamedModel> trained = parts_.encoder->trained()) all.push_back(*trained);
    }
    return all;
  }
  const data::BatchSource& data() const override { return *parts_.data; }
  void warm_start(const LoadedKeys& finetuned) override {
    if (!parts_.model->options().use_pretrain_branch) return;
    load_pretrained(*parts_.model, {PretrainedFile{pretrained_, ""}}, parts_.start, keys_of(finetuned, parts_.name));
  }
  bool supports(torch::Dtype dtype) const override { return dtype != torch::kHalf || parts_.device.is_cuda(); }
  void set_compute_dtype(torch::Dtype dtype) override {
    if (dtype != torch::kFloat64) return parts_.model->set_compute_dtype(dtype);
    for (const nn::NamedModel& model : models()) model.module->to(dtype);
    dtype_ = dtype;
  }

 protected:
  /// @param pretrained name of the file of weights that the published model begins from
  FlowStage(Parts parts, std::string pretrained) : parts_(std::move(parts)), pretrained_(std::move(pretrained)) {}

  /// Parts of a replica.
  Parts twin() const {
    Parts twin;
    twin.name = parts_.name;
    twin.model = Model(parts_.model->options(), nn::Init::kNone);
    twin.model->to(parts_.device);
    share_frozen_weights(*parts_.model, *twin.model);
    if (parts_.encoder) twin.encoder = parts_.encoder->replica();
    twin.data = parts_.data;
    twin.held_out = parts_.held_out;
    twin.decoder = parts_.decoder;
    twin.device = parts_.device;
    twin.start = parts_.start;
    return twin;
  }
  /// Latents, noise or velocities where the model is, in the type of its input.
  torch::Tensor placed(const torch::Tensor& x) const { return x.to(parts_.device, dtype_); }
  /// @param pictures of the batch's items; anything without an encoder @return [B, M, C] on the device
  torch::Tensor condition_of(const torch::Tensor& pictures, std::int64_t items) {
    if (parts_.encoder) return parts_.encoder->tokens(pictures);
    return torch::zeros({items, 1, parts_.model->options().cond_channels}, parts_.device);
  }
  /// As above, where each item loses its picture with a probability.
  torch::Tensor training_condition(const torch::Tensor& pictures, std::int64_t items, double p_uncond,
                                   const at::Generator& generator) {
    const torch::Tensor condition = condition_of(pictures, items);
    if (!parts_.encoder) return condition;
    return flow::replace_condition(condition, flow::draw_condition_dropout(items, p_uncond, generator));
  }
  /// The assets that samples are drawn for.
  const DatasetType& shown_assets() const { return parts_.held_out ? *parts_.held_out : *parts_.data; }

  Parts parts_;

 private:
  std::string pretrained_;
  torch::Dtype dtype_ = torch::kFloat32;  // of the model's inputs: fp64 where everything is
};

}  // namespace anigen::train
