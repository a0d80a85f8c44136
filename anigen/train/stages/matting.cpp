#include "anigen/vision/matting.h"

#include <algorithm>
#include <memory>
#include <string>
#include <utility>

#include "anigen/core/config_fields.h"
#include "anigen/core/log.h"
#include "anigen/data/matting_dataset.h"
#include "anigen/train/stages/stages.h"

namespace anigen::train {

namespace {

using torch::Tensor;

// Arguments of AniGenMattingTrainer beside those all trainers share: weights of the terms.
struct MattingStageOptions {
  double lambda_bce = 1.0, lambda_l1 = 1.0, lambda_dice = 1.0;
  std::int64_t eval_max_assets = 0;  // held-out assets, 0: all

  void fields(ConfigFields& f) {
    f("lambda_bce", lambda_bce, {0.0});
    f("lambda_l1", lambda_l1, {0.0});
    f("lambda_dice", lambda_dice, {0.0});
    f("eval_max_assets", eval_max_assets, {0});
  }
};

// 1 − Dice of soft masks, (2 Σ p a + 1) / (Σ p² + Σ a² + 1) over a picture; mean over pictures. 0 when they are equal.
Tensor dice_loss(const Tensor& found, const Tensor& alpha) {
  const Tensor p = found.flatten(1), a = alpha.flatten(1);
  const Tensor both = 2.0 * (p * a).sum(1) + 1.0;
  return 1.0 - (both / (p.square().sum(1) + a.square().sum(1) + 1.0)).mean();
}

class MattingStage final : public Stage {
 public:
  using Dataset = std::shared_ptr<const data::MattingDataset>;

  MattingStage(const vision::MattingUNetOptions& model, const MattingStageOptions& options,
               std::shared_ptr<const data::BatchSource> data, Dataset held_out, std::string name, torch::Device device)
      : options_(options),
        data_(std::move(data)),
        held_out_(std::move(held_out)),
        name_(std::move(name)),
        device_(device),
        model_(model) {
    model_->to(device_);
  }

  std::vector<nn::NamedModel> models() const override { return {{name_, model_.ptr()}}; }
  const data::BatchSource& data() const override { return *data_; }
  void set_data(std::shared_ptr<const data::BatchSource> data) override { data_ = std::move(data); }
  std::unique_ptr<Stage> replica() const override {
    return std::make_unique<MattingStage>(model_->options(), options_, data_, held_out_, name_, device_);
  }

  Losses losses(const data::Batch& batch, const LossContext&) override {
    const auto& truth = dynamic_cast<const data::MattingBatch&>(batch);
    const Tensor alpha = truth.alpha.to(device_), logits = model_->forward(truth.image.to(device_));
    const Tensor found = logits.sigmoid();
    const Tensor bce = torch::binary_cross_entropy_with_logits(logits, alpha);
    const Tensor l1 = (found - alpha).abs().mean(), dice = dice_loss(found, alpha);
    Losses losses;
    losses.total = options_.lambda_bce * bce + options_.lambda_l1 * l1 + options_.lambda_dice * dice;
    losses.terms = {{"bce", bce}, {"l1", l1}, {"dice", dice}};
    return losses;
  }

  Values evaluate() override {
    if (!held_out_) return {};
    const torch::NoGradGuard no_grad;
    const std::size_t count = looked_at(held_out_->size(), options_.eval_max_assets);
    double iou = 0.0, difference = 0.0;
    for (std::size_t i = 0; i < count; ++i) {
      const auto batch = held_out_->load({data::Draw{i, i}});
      const auto& truth = dynamic_cast<const data::MattingBatch&>(*batch);
      const Tensor alpha = truth.alpha.to(device_), found = model_->forward(truth.image.to(device_)).sigmoid();
      const Tensor p = found > 0.5, a = alpha > 0.5;
      iou += (p & a).sum().item<double>() / std::max(1.0, (p | a).sum().item<double>());
      difference += (found - alpha).abs().mean().item<double>();
    }
    const auto all = static_cast<double>(count);
    return {{"iou", iou / all}, {"mae", difference / all}};
  }

 private:
  MattingStageOptions options_;
  std::shared_ptr<const data::BatchSource> data_;
  Dataset held_out_;
  std::string name_;
  torch::Device device_;
  vision::MattingUNet model_;
};

}  // namespace

std::unique_ptr<Stage> make_matting_stage(const StageRequest& request) {
  MattingStageOptions options;
  ConfigFields f(request.args);
  options.fields(f);
  ConfigReader top(request.config, request.file);
  const auto [name, model] = read_only_model<vision::MattingUNetOptions>(top, {vision::kMattingUNetClass});
  const data::Datasets datasets = data::make_datasets(top.object("dataset"), request.trainer.seed);
  const auto pictures = std::dynamic_pointer_cast<const data::MattingDataset>(datasets.train);
  if (!pictures) throw top.object("dataset").error("name", "this trainer needs the dataset AniGenMattings");
  if (model.image_size != pictures->options().image_size) {
    throw top.object("models").object(name).object("args").error("image_size", "differs from the dataset's image_size");
  }
  const auto held_out = std::dynamic_pointer_cast<const data::MattingDataset>(datasets.eval);
  log::info("{} assets to train on, {} held out", pictures->assets(), held_out ? held_out->assets() : 0);
  return std::make_unique<MattingStage>(model, options, datasets.train, held_out, name, request.device);
}

}  // namespace anigen::train
