#include "anigen/vision/picture_estimator.h"

#include <algorithm>
#include <cmath>
#include <memory>
#include <utility>

#include "anigen/core/config_fields.h"
#include "anigen/core/numeric.h"
#include "anigen/data/picture_dataset.h"
#include "anigen/train/stages/picture_stage.h"

namespace anigen::train {

namespace {

using torch::Tensor;

// Arguments of AniGenPictureEstimatorTrainer beside those all trainers share: weights of the terms.
struct PictureEstimatorStageOptions {
  double lambda_normals = 1.0, lambda_coordinates = 10.0, lambda_camera = 5.0, lambda_family = 0.2;
  std::int64_t eval_max_assets = 0;  // held-out assets, 0: all

  void fields(ConfigFields& f) {
    f("lambda_normals", lambda_normals, {0.0});
    f("lambda_coordinates", lambda_coordinates, {0.0});
    f("lambda_camera", lambda_camera, {0.0});
    f("lambda_family", lambda_family, {0.0});
    f("eval_max_assets", eval_max_assets, {0});
  }
};

Tensor camera_rows(const std::vector<render::PartCamera>& cameras) {
  std::vector<double> rows;
  for (const render::PartCamera& c : cameras) {
    for (const double value :
         {std::sin(c.yaw), std::cos(c.yaw), c.pitch, std::log(c.scale), c.shift_x, c.shift_y, c.nearness})
      rows.push_back(value);
  }
  return torch::tensor(rows, torch::kFloat32).view({-1, vision::kCameraNumbers});
}

// Corners of the box of places that objects fill.
Tensor box_corners() {
  Tensor corners = torch::empty({8, 3});
  float* to = corners.data_ptr<float>();
  for (int corner = 0; corner < 8; ++corner) {
    for (int axis = 0; axis < 3; ++axis) *to++ = ((corner >> axis) & 1) != 0 ? 0.5F : -0.5F;
  }
  return corners;
}

Tensor mean_where(const Tensor& values, const Tensor& mask) {
  return (values * mask).sum() / mask.sum().clamp_min(1.0);
}

// Degrees between two directions in the plane, [B].
Tensor yaw_error(const Tensor& a, const Tensor& b) {
  const Tensor difference = torch::atan2(a.select(1, 0), a.select(1, 1)) - torch::atan2(b.select(1, 0), b.select(1, 1));
  return torch::atan2(difference.sin(), difference.cos()).abs() * (180.0 / kPi);
}

class PictureEstimatorStage final : public PictureStage<PictureEstimatorStage, vision::PictureEstimator,
                                                        data::PictureDataset, PictureEstimatorStageOptions> {
 public:
  using PictureStage::PictureStage;

  Losses losses(const data::Batch& batch, const LossContext&) override {
    const auto& truth = dynamic_cast<const data::PictureBatch&>(batch);
    const vision::PictureEstimate estimate = model_->forward(truth.image.to(device_));
    const Tensor mask = truth.mask.to(device_), family = truth.family.to(device_);
    const Tensor cameras = camera_rows(truth.cameras).to(device_);
    // L = λ_n (1 − n̂ · n) + λ_x |x̂ − x| + λ_c (|p̂ − p| over the corners of the box, and |θ̂ − θ|) + λ_f CE
    const Tensor normals = mean_where(1.0 - (estimate.normals * truth.normals.to(device_)).sum(1), mask);
    const Tensor coordinates = mean_where((estimate.coordinates - truth.coordinates.to(device_)).abs().sum(1), mask);
    const Tensor corners =
        (vision::seen_from(estimate.camera, corners_) - vision::seen_from(cameras, corners_)).abs().mean();
    const Tensor camera = corners + (estimate.camera - cameras).abs().mean();
    Losses losses;
    losses.total =
        options_.lambda_normals * normals + options_.lambda_coordinates * coordinates + options_.lambda_camera * camera;
    losses.terms = {{"normals", normals}, {"coordinates", coordinates}, {"camera", camera}};
    if (model_->options().families > 0 && (family >= 0).any().item<bool>()) {
      const Tensor of_family = torch::nn::functional::cross_entropy(
          estimate.family, family, torch::nn::functional::CrossEntropyFuncOptions().ignore_index(-1));
      losses.total = losses.total + options_.lambda_family * of_family;
      losses.terms.emplace_back("family", of_family);
    }
    return losses;
  }

  Values evaluate() override {
    if (!held_out_) return {};
    const torch::NoGradGuard no_grad;
    const std::vector<std::size_t> places = looked_at(held_out_->size(), options_.eval_max_assets);
    double angle = 0.0, distance = 0.0, known = 0.0, right = 0.0, of_family = 0.0, corners = 0.0;
    std::vector<double> yaws;
    for (const std::size_t i : places) {
      const auto batch = held_out_->load({data::Draw{i, i}});
      const auto& truth = dynamic_cast<const data::PictureBatch&>(*batch);
      const vision::PictureEstimate estimate = model_->forward(truth.image.to(device_));
      const Tensor mask = truth.mask.to(device_), cameras = camera_rows(truth.cameras).to(device_);
      const Tensor cosine = (estimate.normals * truth.normals.to(device_)).sum(1).clamp(-1.0, 1.0);
      const Tensor away = (estimate.coordinates - truth.coordinates.to(device_)).square().sum(1).sqrt();
      angle += mean_where(cosine.acos() * (180.0 / kPi), mask).item<double>();
      distance += mean_where(away, mask).item<double>();
      yaws.push_back(yaw_error(estimate.camera, cameras).item<double>());
      corners += (vision::seen_from(estimate.camera, corners_) - vision::seen_from(cameras, corners_))
                     .narrow(2, 0, 2)
                     .square()
                     .sum(2)
                     .sqrt()
                     .mean()
                     .item<double>();
      known += 1.0;
      const auto family = truth.family.item<std::int64_t>();
      if (family < 0 || model_->options().families == 0) continue;
      of_family += 1.0;
      right += estimate.family.argmax(1).item<std::int64_t>() == family ? 1.0 : 0.0;
    }
    std::nth_element(yaws.begin(), yaws.begin() + static_cast<std::ptrdiff_t>(yaws.size() / 2), yaws.end());
    Values values{{"normals", angle / known},
                  {"coordinates", distance / known},
                  {"yaw", yaws[yaws.size() / 2]},
                  {"corners", corners / known}};
    if (of_family > 0.0) values.emplace_back("family", right / of_family);
    return values;
  }

 private:
  Tensor corners_ = box_corners().to(device_);
};

}  // namespace

std::unique_ptr<Stage> make_picture_estimator_stage(const StageRequest& request) {
  return make_picture_stage<PictureEstimatorStage>(
      request, vision::kPictureEstimatorClass, "AniGenPictures",
      [](const vision::PictureEstimatorOptions& model, const ConfigReader& args, const data::PictureDataset& pictures) {
        const auto families = static_cast<std::int64_t>(pictures.options().families.size());
        if (model.families == families) return;
        throw args.error("families", "is " + std::to_string(model.families) + ", but the dataset tells " +
                                         std::to_string(families) + " apart");
      });
}

}  // namespace anigen::train
