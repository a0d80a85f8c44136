#include "anigen/vision/matting.h"

#include <algorithm>
#include <memory>
#include <string>
#include <utility>

#include "anigen/core/config_fields.h"
#include "anigen/data/matting_dataset.h"
#include "anigen/train/stages/picture_stage.h"

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

class MattingStage final
    : public PictureStage<MattingStage, vision::MattingUNet, data::MattingDataset, MattingStageOptions> {
 public:
  using PictureStage::PictureStage;

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
    const std::vector<std::size_t> places = looked_at(held_out_->size(), options_.eval_max_assets);
    double iou = 0.0, difference = 0.0;
    for (const std::size_t i : places) {
      const auto batch = held_out_->load({data::Draw{i, i}});
      const auto& truth = dynamic_cast<const data::MattingBatch&>(*batch);
      const Tensor alpha = truth.alpha.to(device_), found = model_->forward(truth.image.to(device_)).sigmoid();
      const Tensor p = found > 0.5, a = alpha > 0.5;
      iou += (p & a).sum().item<double>() / std::max(1.0, (p | a).sum().item<double>());
      difference += (found - alpha).abs().mean().item<double>();
    }
    const auto all = static_cast<double>(places.size());
    return {{"iou", iou / all}, {"mae", difference / all}};
  }
};

}  // namespace

std::unique_ptr<Stage> make_matting_stage(const StageRequest& request) {
  return make_picture_stage<MattingStage>(request, vision::kMattingUNetClass, "AniGenMattings",
                                          [](const auto&, const ConfigReader&, const data::MattingDataset&) {});
}

}  // namespace anigen::train
