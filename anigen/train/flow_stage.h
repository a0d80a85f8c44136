#pragma once
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "anigen/features/condition_encoder.h"
#include "anigen/flow/condition_dropout.h"
#include "anigen/flow/flow_stage_options.h"
#include "anigen/nn/init.h"
#include "anigen/train/stage.h"
#include "anigen/train/warm_start.h"

namespace anigen::train {

/// Logs the means of per-item errors over the tenths of the time axis that a micro-batch has items in, as
/// "bin_0.<name>" … "bin_9.<name>"; an empty tenth has no mean. @param errors, t [B]
void add_time_bins(Losses& losses, const std::string& name, const torch::Tensor& errors, const torch::Tensor& t);

/// What the stages of both flows have in common: one flow model, perhaps with an encoder of condition pictures that is
/// trained beside it, over a dataset of latents (reference training-and-data.md, 3.4).
/// @tparam Model a module holder with options(), set_compute_dtype() and a constructor (options, init)
template <typename Model, typename DatasetType, typename Decoder>
class FlowStage : public Stage {
 public:
  using ModelType = Model;
  using Dataset = std::shared_ptr<const DatasetType>;

  /// What a stage works with. Replicas share the datasets and the decoder.
  struct Parts {
    std::string name = "denoiser";  ///< of the model, in the config and in checkpoints
    Model model = nullptr;
    std::unique_ptr<features::ConditionEncoder> encoder;  ///< null: not conditioned, the flow sees one token of zeros
    Dataset data, held_out;                               ///< held_out may be null
    Decoder decoder = nullptr;                            ///< of the latents, for sample(); null: no samples
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
  const loaders::BatchSource& data() const override { return *parts_.data; }
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
  /// The same, where each item loses its picture with a probability.
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
