#include "anigen/train/structured_latent_flow_stage.h"

#include <utility>

#include "anigen/flow/time_bins.h"
#include "anigen/train/loss_generator.h"
#include "anigen/train/sparse_batch.h"

namespace anigen::train {
namespace {

// TRELLIS' flow for the geometry stream; unlike those of the other models it is not called like its class.
constexpr const char* kPretrainedFlow = "AniGenSlatFlowImage";

torch::Tensor item_of_rows(const sparse::SparseTensor& voxels) {
  return voxels.support->coords().select(1, 0).to(voxels.feats.device(), torch::kInt64);
}

}  // namespace

using torch::Tensor;

StructuredLatentFlowStage::StructuredLatentFlowStage(const models::StructuredLatentFlowStageOptions& options,
                                                     Parts parts)
    : FlowStage(std::move(parts), kPretrainedFlow), options_(options) {}

std::unique_ptr<Stage> StructuredLatentFlowStage::replica() const {
  return std::make_unique<StructuredLatentFlowStage>(options_, twin());
}

StructuredLatentFlowStage::Latents StructuredLatentFlowStage::latents_of(
    const loaders::StructuredLatentBatch& batch) const {
  const auto voxels = [&](const loaders::RaggedVoxels& given) {
    const sparse::SparseTensor sparse = sparse_of(given, parts_.device);
    return sparse.with(placed(sparse.feats));
  };
  Latents latents{voxels(batch.x_0), voxels(batch.x_0_skl), Tensor()};
  if (options_.use_joint_num_cond) latents.joints_num = batch.joints_num.to(parts_.device);
  return latents;
}

StructuredLatentFlowStage::Errors StructuredLatentFlowStage::errors(const Latents& latents, const Tensor& t,
                                                                    const flow::Streams& noise,
                                                                    const Tensor& condition) {
  const double sigma = options_.sigma_min;
  const Tensor times = t.to(parts_.device);
  const auto noisy = [&](const sparse::SparseTensor& x_0, const Tensor& e) {
    return x_0.with(flow::noisy(x_0.feats, e, times.index_select(0, item_of_rows(x_0)), sigma));
  };
  const Tensor e = placed(noise[0]), e_skl = placed(noise[1]);
  const models::StructuredVelocity velocity = parts_.model->forward(
      noisy(latents.shape, e), noisy(latents.skeleton, e_skl), flow::model_time(times), condition, latents.joints_num);
  return {(velocity.x.feats - flow::velocity_target(latents.shape.feats, e, sigma)).square(),
          (velocity.x_skl.feats - flow::velocity_target(latents.skeleton.feats, e_skl, sigma)).square()};
}

Tensor StructuredLatentFlowStage::geometry_channels(const Tensor& shape) const {
  return shape.slice(1, 0, parts_.model->options().geometry.in_channels);
}

Tensor StructuredLatentFlowStage::skin_channels(const Tensor& shape) const {
  return shape.slice(1, parts_.model->options().geometry.in_channels);
}

Losses StructuredLatentFlowStage::losses(const loaders::Batch& batch, const LossContext& context) {
  const auto& given = dynamic_cast<const loaders::StructuredLatentBatch&>(batch);
  Latents latents = latents_of(given);
  const std::int64_t items = latents.shape.support->items().items();
  // In the published order: noise of the shape, times, noise of the skeleton.
  const at::Generator generator = loss_generator(context, "structured-latent flow");
  const Tensor noise =
      models::shape_latent_noise(parts_.model->options(), *latents.shape.support, options_.smoothing, generator);
  const Tensor t = options_.t_schedule.sample(items, generator);
  const Tensor noise_skl = torch::randn(given.x_0_skl.feats.sizes(), generator);
  const Tensor condition = training_condition(given.cond, items, options_.p_uncond, generator);
  if (latents.joints_num.defined()) {  // last, so that the other draws are those of a run without joint counts
    const Tensor dropped = flow::draw_condition_dropout(items, options_.p_uncond_joint_num, generator);
    latents.joints_num = flow::replace_condition(latents.joints_num, dropped);
  }
  const Errors found = errors(latents, t, {noise, noise_skl}, condition);
  const Tensor mse = found.shape.mean(), mse_skl = found.skeleton.mean();
  Losses losses{mse + mse_skl,
                {{"mse", mse},
                 {"mse_skl", mse_skl},
                 {"mse_geo", geometry_channels(found.shape).detach().mean()},
                 {"mse_skin", skin_channels(found.shape).detach().mean()}}};
  const auto per_item = [&](const Tensor& rows, const sparse::SparseTensor& voxels) {
    return flow::mean_per_item(rows.detach(), item_of_rows(voxels), items);
  };
  add_time_bins(losses, "mse", per_item(found.shape, latents.shape), t);
  add_time_bins(losses, "mse_skl", per_item(found.skeleton, latents.skeleton), t);
  return losses;
}

Values StructuredLatentFlowStage::evaluate() {
  if (!parts_.held_out) return {};
  const torch::NoGradGuard no_grad;
  const loaders::StructuredLatentDataset& assets = *parts_.held_out;
  const std::size_t count = options_.eval_count(assets.size());
  const Tensor grid = options_.eval_grid();
  Values sums{{"mse", 0.0}, {"mse_geo", 0.0}, {"mse_skin", 0.0}, {"mse_skl", 0.0}};
  for (std::size_t i = 0; i < count; ++i) {
    const auto batch = assets.load({loaders::Draw{i, i}});
    const auto& given = dynamic_cast<const loaders::StructuredLatentBatch&>(*batch);
    const Latents latents = latents_of(given);
    const Tensor condition = condition_of(given.cond, 1);
    const at::Generator generator = nn::numbered_generator(options_.seed, "held-out structured-latent flow", i);
    // Time by time: what was worked out about the voxels serves all of them.
    for (const Tensor& t : grid.split(1)) {
      const flow::Streams noise = models::structured_latent_noise(
          parts_.model->options(), *latents.shape.support, *latents.skeleton.support, options_.smoothing, generator);
      const Errors found = errors(latents, t, noise, condition);
      const Tensor means[] = {found.shape, geometry_channels(found.shape), skin_channels(found.shape), found.skeleton};
      for (std::size_t k = 0; k < sums.size(); ++k) sums[k].second += means[k].mean().item<double>();
    }
  }
  for (auto& [name, value] : sums) value /= static_cast<double>(count) * static_cast<double>(grid.size(0));
  return sums;
}

}  // namespace anigen::train
