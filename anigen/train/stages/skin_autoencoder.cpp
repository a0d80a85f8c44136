#include <algorithm>

#include "anigen/core/config_fields.h"
#include "anigen/core/log.h"
#include "anigen/data/skin_dataset.h"
#include "anigen/skin_field/loss.h"
#include "anigen/skin_field/skin_autoencoder.h"
#include "anigen/train/stages/stages.h"

namespace anigen::train {

namespace {

using torch::Tensor;

struct RowSums {
  double l1 = 0.0, kl = 0.0;
};

// Means over the rows, in double: an evaluation must not depend on the order of thousands of fp32 additions.
RowSums row_errors(const Tensor& log_predicted, const Tensor& target) {
  const Tensor kl = torch::xlogy(target, target) - target * log_predicted;
  const Tensor l1 = (log_predicted.exp() - target).abs();
  const auto rows = static_cast<double>(target.size(0));
  return {l1.sum(torch::kFloat64).item<double>() / rows, kl.sum(torch::kFloat64).item<double>() / rows};
}

// Arguments of AniGenSkinAETrainer beside those all trainers share (docs/reference/training.md, 3.1).
struct SkinAutoEncoderStageOptions {
  skin_field::SkinLossOptions loss;    // `lambda_*_skin`; ours: `kl_reduction` "element" (published) or "row"
  std::int64_t num_skin_samples = 0;   // points per asset; absent or null: all vertices
  bool unit_gain = false;              // ours, `init`: "published", or "unit_gain" (skin_field/skin_autoencoder.h)
  data::Augmentations augmentations;   // ours
  std::int64_t eval_max_vertices = 0;  // ours: vertices per held-out asset, 0: all
  std::int64_t eval_max_assets = 0;    // ours: held-out assets, 0: all

  void fields(ConfigFields& f) {
    f("lambda_kl_skin", loss.lambda_kl_skin, {0.0});
    f("lambda_l1_skin", loss.lambda_l1_skin, {0.0});
    f("lambda_l2_skin", loss.lambda_l2_skin, {0.0});
    if (loss.lambda_kl_skin + loss.lambda_l1_skin + loss.lambda_l2_skin == 0.0)
      throw f.error("lambda_kl_skin", "every term of the loss has weight 0");
    using skin_field::SkinKlMean;
    f("kl_reduction", loss.kl_mean, {{"element", SkinKlMean::kElements}, {"row", SkinKlMean::kRows}});
    f.or_null("num_skin_samples", num_skin_samples, {1, 1 << 24});
    unit_gain = f.reader().choice("init", "published", {"published", "unit_gain"}) == "unit_gain";
    f.object("augmentations", augmentations);
    f("eval_max_vertices", eval_max_vertices, {0});
    f("eval_max_assets", eval_max_assets, {0});
  }
};

class SkinAutoEncoderStage final : public Stage {
 public:
  using Datasets = std::shared_ptr<const data::SkinDataset>;

  // held_out may be null: evaluate() then returns nothing.
  SkinAutoEncoderStage(const skin_field::SkinAutoEncoderOptions& model, const SkinAutoEncoderStageOptions& options,
                       std::shared_ptr<const data::BatchSource> data, Datasets held_out, std::string model_name,
                       torch::Device device)
      : model_options_(model),
        options_(options),
        data_(std::move(data)),
        held_out_(std::move(held_out)),
        model_name_(std::move(model_name)),
        device_(device),
        model_(model) {
    if (options_.unit_gain) skin_field::rescale_to_unit_gain(model_);
    model_->to(device_);
  }

  std::vector<nn::NamedModel> models() const override { return {{model_name_, model_.ptr()}}; }
  const data::BatchSource& data() const override { return *data_; }
  void set_data(std::shared_ptr<const data::BatchSource> data) override { data_ = std::move(data); }
  bool supports(torch::Dtype dtype) const override { return dtype == torch::kFloat32 || dtype == torch::kFloat64; }
  void set_compute_dtype(torch::Dtype dtype) override {
    Stage::set_compute_dtype(dtype);
    model_->to(dtype);
    dtype_ = dtype;
  }
  std::unique_ptr<Stage> replica() const override {
    return std::make_unique<SkinAutoEncoderStage>(model_options_, options_, data_, held_out_, model_name_, device_);
  }

  Losses losses(const data::Batch& batch, const LossContext&) override {
    const auto& rigs = dynamic_cast<const data::SkinBatch&>(batch);
    const skin_field::SkeletonBatch skeletons = skeletons_of(rigs.joints, rigs.parents);
    const std::vector<Tensor> skin = on_device(rigs.skin, device_, dtype_);
    // L = λ_kl KL(s ‖ ŝ) + λ_1 |s − ŝ| + λ_2 (s − ŝ)²
    const skin_field::SkinLosses computed =
        skin_field::skin_losses_from_log(model_->reconstruct_log(skeletons, skin), skin, options_.loss);
    Losses losses{computed.total, {}};
    if (computed.kl.defined()) losses.terms.emplace_back("kl", computed.kl);
    if (computed.l1.defined()) losses.terms.emplace_back("l1", computed.l1);
    if (computed.l2.defined()) losses.terms.emplace_back("l2", computed.l2);
    return losses;
  }

  Values evaluate() override {
    if (!held_out_) return {};
    torch::NoGradGuard no_grad;
    const std::vector<std::size_t> places = looked_at(held_out_->size(), options_.eval_max_assets);
    double l1 = 0.0, kl = 0.0;
    for (const std::size_t i : places) {
      const auto rig = held_out_->vertices_of(i, static_cast<std::size_t>(options_.eval_max_vertices));
      const skin_field::SkeletonBatch skeleton = skeletons_of(rig->joints, rig->parents);
      const std::vector<Tensor> skin = on_device(rig->skin, device_, dtype_);
      const RowSums errors = row_errors(model_->reconstruct_log(skeleton, skin).front(), skin.front());
      l1 += errors.l1;
      kl += errors.kl;
      log::debug("held out {}: l1 {:.4f}, kl {:.4f}", held_out_->id(i), errors.l1, errors.kl);
    }
    return {{"l1", l1 / static_cast<double>(places.size())}, {"kl", kl / static_cast<double>(places.size())}};
  }

 private:
  skin_field::SkeletonBatch skeletons_of(const std::vector<Tensor>& joints, const std::vector<Tensor>& parents) const {
    return skin_field::SkeletonBatch::from_lists(on_device(joints, torch::kCPU, dtype_), parents).to(device_);
  }

  skin_field::SkinAutoEncoderOptions model_options_;
  SkinAutoEncoderStageOptions options_;
  std::shared_ptr<const data::BatchSource> data_;
  Datasets held_out_;
  std::string model_name_;
  torch::Device device_;
  torch::Dtype dtype_ = torch::kFloat32;
  skin_field::SkinAutoEncoder model_;
};

}  // namespace

std::unique_ptr<Stage> make_skin_autoencoder_stage(const StageRequest& request) {
  SkinAutoEncoderStageOptions options;
  options.loss = skin_field::SkinLossOptions::compatible(request.trainer.compatibility);
  ConfigFields f(request.args);
  options.fields(f);
  ConfigReader top(request.config, request.file);
  const auto [name, model] = read_only_model<skin_field::SkinAutoEncoderOptions>(top, {"SkinAutoEncoder"});
  const auto data_options = read_dataset<data::SkinDatasetOptions>(top, "AniGenSparseFeat2Skeleton");

  data::SkinDataset::Options reading;
  reading.seed = request.trainer.seed;
  reading.num_skin_samples = options.num_skin_samples;
  reading.augmentations = options.augmentations;
  reading.skip_broken = data_options.skip_broken;
  reading.memory_budget = static_cast<std::uintmax_t>(data_options.memory_budget_mb) << 20;
  const data::TrainingData assets =
      data::open_training(data_options, [reading](std::vector<data::AssetId> chosen, const data::BatchSource* earlier) {
        return std::make_shared<data::SkinDataset>(std::move(chosen), reading,
                                                   dynamic_cast<const data::SkinDataset*>(earlier));
      });
  SkinAutoEncoderStage::Datasets held_out;
  if (!assets.eval.empty()) {
    reading.augmentations = {};
    held_out = std::make_shared<const data::SkinDataset>(assets.eval, reading);
  }
  log::info("{} assets to train on, {} held out", dynamic_cast<const data::SkinDataset&>(*assets.train).assets(),
            held_out ? held_out->size() : 0);
  return std::make_unique<SkinAutoEncoderStage>(model, options, assets.train, held_out, name, request.device);
}

}  // namespace anigen::train
