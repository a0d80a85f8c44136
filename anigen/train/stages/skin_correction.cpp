#include <algorithm>
#include <array>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "anigen/core/config_fields.h"
#include "anigen/data/skin_correction_dataset.h"
#include "anigen/metrics/skin_metrics.h"
#include "anigen/skin_correction/network.h"
#include "anigen/train/stages/picture_stage.h"

namespace anigen::train {

namespace {

using skin_correction::SkinCorrection;
using torch::Tensor;

// Arguments of AniGenSkinCorrectionTrainer beside those all trainers share: weights of the terms.
struct SkinCorrectionStageOptions {
  double lambda_kl = 1.0, lambda_l1 = 1.0;
  double feature_noise = 0.2;        // of features in training, in their spreads
  std::int64_t eval_max_assets = 0;  // held-out assets, 0: all

  void fields(ConfigFields& f) {
    f("lambda_kl", lambda_kl, {0.0});
    f("lambda_l1", lambda_l1, {0.0});
    f("feature_noise", feature_noise, {0.0, 10.0});
    f("eval_max_assets", eval_max_assets, {0});
  }
};

// Mean over networks and vertices of Σ w (log(w + ε) − log ŵ), of the candidates. @param logs [M, N, K] log ŵ
Tensor candidate_divergence(const Tensor& truth, const Tensor& logs) {
  return (truth * ((truth + metrics::kKlEpsilon).log() - logs)).sum(2).mean();
}

// ℓ1 and divergence of one method, sums over vertices. What lies on joints that are no candidates is lost to both.
struct MethodErrors {
  double l1 = 0.0, kl = 0.0;

  void add(const Tensor& weights, const Tensor& truth, const Tensor& missed) {
    constexpr double kEpsilon = metrics::kKlEpsilon;
    l1 += ((weights - truth).abs().sum(1) + missed).sum().item<double>();
    const Tensor of_candidates = truth * ((truth + kEpsilon) / (weights + kEpsilon)).log();
    const Tensor of_missed = missed * ((missed + kEpsilon) / kEpsilon).log();
    kl += (of_candidates.sum(1) + of_missed).sum().item<double>();
  }
};

constexpr std::array<const char*, 3> kMethods = {"", "heat_", "geovoxel_"};

// Means over assets of means over vertices.
struct GroupErrors {
  std::array<MethodErrors, kMethods.size()> methods;
  double missed = 0.0, assets = 0.0;

  void add(const std::array<MethodErrors, kMethods.size()>& of_asset, double missed_weight, double vertices) {
    for (std::size_t m = 0; m < kMethods.size(); ++m) {
      methods[m].l1 += of_asset[m].l1 / vertices;
      methods[m].kl += of_asset[m].kl / vertices;
    }
    missed += missed_weight / vertices;
    assets += 1.0;
  }
  void append(const std::string& group, Values& values) const {
    for (std::size_t m = 0; m < kMethods.size(); ++m) {
      values.emplace_back(group + kMethods[m] + "l1", methods[m].l1 / assets);
      values.emplace_back(group + kMethods[m] + "kl", methods[m].kl / assets);
    }
    values.emplace_back(group + "missed", missed / assets);
  }
};

class SkinCorrectionStage final : public PictureStage<SkinCorrectionStage, SkinCorrection, data::SkinCorrectionDataset,
                                                      SkinCorrectionStageOptions> {
 public:
  using PictureStage::PictureStage;

  // Each network learns from its own answer: the mean of all would let them share one error.
  Losses losses(const data::Batch& batch, const LossContext& context) override {
    const auto& vertices = dynamic_cast<const data::SkinCorrectionBatch&>(batch);
    const Tensor truth = vertices.truth.to(device_);
    Tensor noise;
    if (options_.feature_noise > 0.0) {
      const at::Generator generator = loss_generator(context, "skin features");
      noise = options_.feature_noise * torch::randn(vertices.pairs.sizes(), generator, torch::kFloat).to(device_);
    }
    const Tensor logs = model_->of_members(vertices.pairs.to(device_), vertices.assets.to(device_),
                                           vertices.present.to(device_), noise);
    const Tensor kl = candidate_divergence(truth, logs), l1 = (logs.exp() - truth).abs().sum(2).mean();
    Losses losses;
    losses.total = options_.lambda_kl * kl + options_.lambda_l1 * l1;
    losses.terms = {{"kl", kl}, {"l1", l1}};
    return losses;
  }

  Values evaluate() override {
    if (!held_out_) return {};
    const torch::NoGradGuard no_grad;
    GroupErrors all, real;
    for (const std::size_t i : looked_at(held_out_->assets(), options_.eval_max_assets)) {
      const auto batch = held_out_->all_of(i);
      const auto errors = errors_of(*batch);
      const double missed = batch->missed.sum().item<double>(), rows = static_cast<double>(batch->missed.size(0));
      all.add(errors, missed, rows);
      if (data::is_real(held_out_->asset(i))) real.add(errors, missed, rows);
    }
    Values values;
    all.append("", values);
    if (real.assets > 0.0 && real.assets < all.assets) real.append("real_", values);
    return values;
  }

 private:
  // As many influences of each vertex as one glTF attribute holds, of all methods.
  std::array<MethodErrors, kMethods.size()> errors_of(const data::SkinCorrectionBatch& batch) {
    constexpr std::int64_t kRowsAtOnce = 4096;
    std::array<MethodErrors, kMethods.size()> errors;
    for (std::int64_t first = 0; first < batch.missed.size(0); first += kRowsAtOnce) {
      const std::int64_t rows = std::min(kRowsAtOnce, batch.missed.size(0) - first);
      const auto part = [&](const Tensor& whole) { return whole.narrow(0, first, rows).to(device_); };
      const Tensor pairs = part(batch.pairs), truth = part(batch.truth), missed = part(batch.missed);
      const Tensor found = model_->forward(pairs, part(batch.assets), part(batch.present)).exp();
      const Tensor heat = skin_correction::classical_weights(pairs, rigging::kHeatLog);
      const Tensor geodesic = skin_correction::classical_weights(pairs, rigging::kGeodesicLog);
      errors[0].add(skin_correction::strongest_weights(found), truth, missed);
      errors[1].add(skin_correction::strongest_weights(heat), truth, missed);
      errors[2].add(skin_correction::strongest_weights(geodesic), truth, missed);
    }
    return errors;
  }
};

}  // namespace

std::unique_ptr<Stage> make_skin_correction_stage(const StageRequest& request) {
  SkinCorrectionStageOptions options;
  ConfigFields f(request.args);
  options.fields(f);
  ConfigReader top(request.config, request.file);
  const auto [name, model] =
      read_only_model<skin_correction::SkinCorrectionOptions>(top, {skin_correction::kSkinCorrectionClass});
  const data::Datasets datasets = data::make_datasets(top.object("dataset"), request.trainer.seed);
  const auto train = std::dynamic_pointer_cast<const data::SkinCorrectionDataset>(datasets.train);
  if (!train) throw top.object("dataset").error("name", "this trainer needs the dataset AniGenSkinCorrections");
  const ConfigReader args = top.object("models").object(name).object("args");
  if (model.features().candidates != train->options().features.candidates)
    throw args.error("candidates", "differs from the dataset's candidates");
  if (model.features().resolution != train->options().features.resolution)
    throw args.error("geovoxel_resolution", "differs from the dataset's geovoxel_resolution");
  const auto held_out = std::dynamic_pointer_cast<const data::SkinCorrectionDataset>(datasets.eval);
  log::info("{} assets to train on, {} held out", train->assets(), held_out ? held_out->assets() : 0);
  return std::make_unique<SkinCorrectionStage>(model, options, datasets.train, held_out, name, request.device);
}

}  // namespace anigen::train
