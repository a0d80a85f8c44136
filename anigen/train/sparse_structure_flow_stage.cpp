#include "anigen/train/sparse_structure_flow_stage.h"

#include <utility>

#include "anigen/flow/time_bins.h"
#include "anigen/models/sparse_structure_runs.h"
#include "anigen/train/loss_generator.h"

namespace anigen::train {

using torch::Tensor;

SparseStructureFlowStage::SparseStructureFlowStage(const models::SparseStructureFlowStageOptions& options, Parts parts)
    : FlowStage(std::move(parts), models::kSparseStructureFlowClass), options_(options) {}

std::unique_ptr<Stage> SparseStructureFlowStage::replica() const {
  return std::make_unique<SparseStructureFlowStage>(options_, twin());
}

SparseStructureFlowStage::ItemErrors SparseStructureFlowStage::errors(const loaders::StructureLatentBatch& latents,
                                                                      const Tensor& t, const Tensor& noise,
                                                                      const Tensor& noise_skl,
                                                                      const Tensor& condition) {
  const torch::Device device = parts_.device;
  const Tensor times = t.to(device), e = placed(noise), e_skl = placed(noise_skl);
  const Tensor x_0 = placed(latents.x_0), x_0_skl = placed(latents.x_0_skl);
  const double sigma = options_.sigma_min;
  const models::Velocity velocity = parts_.model->forward(
      flow::noisy(x_0, e, times, sigma), flow::noisy(x_0_skl, e_skl, times, sigma), flow::model_time(times), condition);
  return {flow::mse_per_item(velocity.shape, flow::velocity_target(x_0, e, sigma)),
          flow::mse_per_item(velocity.skeleton, flow::velocity_target(x_0_skl, e_skl, sigma))};
}

Losses SparseStructureFlowStage::losses(const loaders::Batch& batch, const LossContext& context) {
  const auto& latents = dynamic_cast<const loaders::StructureLatentBatch&>(batch);
  // In the published order: noise of the shape, noise of the skeleton, times.
  const at::Generator generator = loss_generator(context, "sparse-structure flow");
  const Tensor noise = torch::randn(latents.x_0.sizes(), generator);
  const Tensor noise_skl = torch::randn(latents.x_0_skl.sizes(), generator);
  const std::int64_t items = latents.x_0.size(0);
  const Tensor t = options_.t_schedule.sample(items, generator);
  const Tensor condition = training_condition(latents.cond, items, options_.p_uncond, generator);
  const ItemErrors found = errors(latents, t, noise, noise_skl, condition);
  const Tensor mse = found.shape.mean(), mse_skl = found.skeleton.mean();
  Losses losses{mse + mse_skl, {{"mse", mse}, {"mse_skl", mse_skl}}};
  const Tensor times = t.to(found.shape.device());
  add_time_bins(losses, "mse", found.shape, times);
  add_time_bins(losses, "mse_skl", found.skeleton, times);
  return losses;
}

Values SparseStructureFlowStage::evaluate() {
  if (!parts_.held_out) return {};
  const torch::NoGradGuard no_grad;
  const loaders::StructureLatentDataset& assets = *parts_.held_out;
  const std::size_t count = options_.eval_count(assets.size());
  const Tensor t = options_.eval_grid();
  const std::int64_t times = t.size(0);
  double mse = 0.0, mse_skl = 0.0;
  for (std::size_t i = 0; i < count; ++i) {
    const auto batch = assets.load({loaders::Draw{i, i}});
    auto latents = dynamic_cast<const loaders::StructureLatentBatch&>(*batch);
    const Tensor condition = condition_of(latents.cond, 1);  // once: the model takes it for all times
    latents.x_0 = latents.x_0.expand({times, -1, -1, -1, -1}).contiguous();
    latents.x_0_skl = latents.x_0_skl.expand({times, -1, -1, -1, -1}).contiguous();
    const at::Generator generator = nn::numbered_generator(options_.seed, "held-out flow", i);
    const Tensor noise = torch::randn(latents.x_0.sizes(), generator);
    const Tensor noise_skl = torch::randn(latents.x_0_skl.sizes(), generator);
    const ItemErrors found = errors(latents, t, noise, noise_skl, condition);
    mse += found.shape.mean().item<double>();
    mse_skl += found.skeleton.mean().item<double>();
  }
  return {{"mse", mse / static_cast<double>(count)}, {"mse_skl", mse_skl / static_cast<double>(count)}};
}

}  // namespace anigen::train
