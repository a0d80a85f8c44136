#pragma once
#include <algorithm>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "anigen/core/config.h"
#include "anigen/core/log.h"
#include "anigen/data/datasets.h"
#include "anigen/data/voxel_files.h"
#include "anigen/flow/matching.h"
#include "anigen/flow/sampler.h"
#include "anigen/nn/init.h"
#include "anigen/nn/state_dict.h"
#include "anigen/sparse/support.h"
#include "anigen/train/stage.h"
#include "anigen/train/stages/stages.h"
#include "anigen/train/warm_start.h"
#include "anigen/vision/condition.h"

namespace anigen::train {

/// Voxels of a batch for the sparse models: features on the device, places where they are.
/// @throws InputError for a voxel that an asset has twice
inline sparse::SparseTensor sparse_of(const data::RaggedVoxels& voxels, torch::Device device) {
  const auto items = static_cast<std::int64_t>(voxels.lengths.size());
  return {sparse::Support::create(voxels.coords, items), nn::to_device(voxels.feats, device)};
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

/// Logs the means of per-item errors over the tenths of the time axis that a micro-batch has items in, as
/// "bin_0.<name>" … "bin_9.<name>"; an empty tenth has no mean. @param errors [B] @param t [B], CPU
void add_time_bins(Losses& losses, const std::string& name, const torch::Tensor& errors, const torch::Tensor& t);

/// Frame of the stages of both flows: one flow model, perhaps with an encoder of condition pictures that is trained
/// beside it, over a dataset of latents (docs/reference/training.md, 3.6). A stage says what the loss of a batch is,
/// how held-out latents are judged and what a sample looks like.
/// @tparam Model a module holder with options(), set_compute_dtype() and a constructor (options, init)
/// @tparam DatasetType of Batches of latents with `cond` @tparam Options flow::FlowStageOptions and what is the stage's
/// @tparam Row of a sheet of samples
template <typename Model, typename DatasetType, typename Latents, typename Decoder, typename Options, typename Row>
class FlowStage : public Stage {
 public:
  using Dataset = std::shared_ptr<const DatasetType>;

  /// Parts of a stage. Replicas share the datasets and the decoder.
  struct Parts {
    std::string name = "denoiser";  ///< of the model, in the config and in checkpoints
    Model model = nullptr;
    std::shared_ptr<vision::ConditionEncoder> encoder;  ///< null: not conditioned, the flow sees one token of zeros
    Dataset data, held_out;                             ///< held_out may be null
    Decoder decoder = nullptr;                          ///< of the latents, for sample(); null: no samples
    torch::Device device = torch::kCPU;
    WarmStartOptions start;
  };

  /// @param pretrained name of the file of weights that the published model begins from
  FlowStage(const Options& options, Parts parts, std::string pretrained)
      : options_(options), parts_(std::move(parts)), pretrained_(std::move(pretrained)) {}

  std::vector<nn::NamedModel> models() const override {
    std::vector<nn::NamedModel> all{{parts_.name, parts_.model.ptr()}};
    if (parts_.encoder) {
      if (const std::optional<nn::NamedModel> trained = parts_.encoder->trained()) all.push_back(*trained);
    }
    return all;
  }
  const data::BatchSource& data() const override { return *parts_.data; }
  void set_data(std::shared_ptr<const data::BatchSource> data) override {
    parts_.data = std::dynamic_pointer_cast<const DatasetType>(data);
  }
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
  Losses losses(const data::Batch& batch, const LossContext& context) final {
    return loss(dynamic_cast<const Latents&>(batch), context);
  }
  Values evaluate() final {
    if (!parts_.held_out) return {};
    const torch::NoGradGuard no_grad;
    Values sums;
    double terms = 0.0;
    for (const std::size_t i : looked_at(parts_.held_out->size(), options_.eval_max_assets)) {
      const auto batch = parts_.held_out->load({data::Draw{i, i}});
      const auto& latents = dynamic_cast<const Latents&>(*batch);
      // Once: the model takes the condition for all times.
      terms += judge(latents, condition_of(latents.cond, 1), i, sums);
    }
    for (auto& [name, value] : sums) value /= terms;
    return sums;
  }
  void sample(const std::filesystem::path& folder) final {
    if (!parts_.decoder) return;
    const torch::NoGradGuard no_grad;
    const DatasetType& assets = parts_.held_out ? *parts_.held_out : *parts_.data;
    std::vector<Row> rows;
    const std::size_t count = std::min(static_cast<std::size_t>(options_.sample_assets), assets.assets());
    for (std::size_t i = 0; i < count; ++i) {
      const auto batch = assets.load({data::Draw{assets.item_of(i), i}});  // each once, however often it repeats
      const auto& latents = dynamic_cast<const Latents&>(*batch);
      add_sample(latents, condition_of(latents.cond, 1), assets.asset(i), i, rows);
    }
    if (!rows.empty()) write_sheet(folder / "samples.png", rows);
  }

 protected:
  virtual Losses loss(const Latents& latents, const LossContext& context) = 0;
  /// Adds the errors of a held-out asset under fixed noise. @param sums empty at first
  /// @return the number of terms that were added to each sum
  virtual double judge(const Latents& latents, const torch::Tensor& condition, std::uint64_t index, Values& sums) = 0;
  /// Adds what a sheet shows of an asset, from fixed noise.
  virtual void add_sample(const Latents& latents, const torch::Tensor& condition, const data::AssetId& asset,
                          std::uint64_t index, std::vector<Row>& rows) = 0;
  virtual void write_sheet(const std::filesystem::path& file, const std::vector<Row>& rows) const = 0;

  /// Parts of a replica.
  Parts twin() const {
    Parts twin = parts_;
    twin.model = Model(parts_.model->options(), nn::Init::kNone);
    twin.model->to(parts_.device);
    share_frozen_weights(*parts_.model, *twin.model);
    if (parts_.encoder) twin.encoder = parts_.encoder->replica();
    return twin;
  }
  /// Latents, noise or velocities where the model is, in the type of its input.
  torch::Tensor placed(const torch::Tensor& x) const { return nn::to_device(x, parts_.device).to(dtype_); }
  /// @param pictures of the batch's items; anything without an encoder @return [B, M, C] on the device
  torch::Tensor condition_of(const torch::Tensor& pictures, std::int64_t items) {
    if (parts_.encoder) return parts_.encoder->tokens(pictures);
    return torch::zeros({items, 1, parts_.model->options().cond_channels}, parts_.device);
  }
  /// As above, where each item loses its picture with the probability p_uncond.
  torch::Tensor training_condition(const torch::Tensor& pictures, std::int64_t items, const at::Generator& generator) {
    const torch::Tensor condition = condition_of(pictures, items);
    if (!parts_.encoder) return condition;
    return flow::replace_condition(condition, flow::draw_condition_dropout(items, options_.p_uncond, generator));
  }

  Options options_;
  Parts parts_;

 private:
  std::string pretrained_;
  torch::Dtype dtype_ = torch::kFloat32;  // of the model's inputs: fp64 where everything is
};

/// The options of a flow stage and its parts but the decoder. @throws InputError naming file and JSON pointer
template <typename StageType, typename Options, typename ModelOptions, typename DatasetType>
std::pair<Options, typename StageType::Parts> flow_parts(const StageRequest& request, const FlowConfigNames& names) {
  Options options = Options::read(request.args);
  options.seed = request.trainer.seed;
  ConfigReader top(request.config, request.file);
  const bool conditioned = top.object("trainer").text("name", "") == names.conditioned_trainer;
  typename StageType::Parts parts;
  parts.device = request.device;
  parts.start = WarmStartOptions::read(request.args);
  auto [name, model] = read_only_model<ModelOptions>(top, names.model_classes);
  parts.name = name;
  if (!parts.start.enabled) model.use_pretrain_branch = model.freeze_pretrain_branch = false;
  if (conditioned) vision::read_condition_arguments(request.args);
  const ConfigReader dataset = top.object("dataset");
  const data::Datasets datasets = data::make_datasets(dataset, request.trainer.seed);
  const auto latents = [&](const std::shared_ptr<const data::BatchSource>& source) {
    const auto found = std::dynamic_pointer_cast<const DatasetType>(source);
    if (!source || (found && found->options().image_conditioned == conditioned)) return found;
    throw dataset.error("name", std::string("this trainer needs the dataset ") +
                                    (conditioned ? names.conditioned_dataset : names.plain_dataset));
  };
  parts.data = latents(datasets.train);
  parts.held_out = latents(datasets.eval);
  parts.model = decltype(parts.model)(model);
  parts.model->to(request.device);
  log::info("{} assets to train on, {} held out", parts.data->assets(), parts.held_out ? parts.held_out->assets() : 0);
  if (conditioned) {
    const auto& reading = parts.data->options();
    const bool normals = reading.condition == data::ConditionPictures::kNormals;
    log::info("conditioned on pictures of {}", normals ? "normals" : "colour");
    parts.encoder =
        vision::make_condition_encoder(request.args, reading.image_size, model.cond_channels, request.device);
  }
  return {options, std::move(parts)};
}

}  // namespace anigen::train
