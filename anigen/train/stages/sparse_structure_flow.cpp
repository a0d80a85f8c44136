#include "anigen/train/stages/sparse_structure_flow.h"

#include <algorithm>
#include <utility>

#include "anigen/core/numeric.h"
#include "anigen/data/latent_files.h"
#include "anigen/flow/matching.h"
#include "anigen/sparse_structure/autoencoder.h"
#include "anigen/sparse_structure/flow.h"
#include "anigen/sparse_structure/voxel_picture.h"
#include "anigen/train/stage.h"
#include "anigen/train/stages/flow_stage.h"

// From a config to the stage; what the stage does is in sparse_structure_flow_stage.cpp.

// Samples of a run.

namespace anigen::train {

using torch::Tensor;

SparseStructureFlowStage::SparseStructureFlowStage(const sparse_structure::SparseStructureFlowStageOptions& options,
                                                   Parts parts)
    : FlowStage(std::move(parts), sparse_structure::kSparseStructureFlowClass), options_(options) {}

std::unique_ptr<Stage> SparseStructureFlowStage::replica() const {
  return std::make_unique<SparseStructureFlowStage>(options_, twin());
}

SparseStructureFlowStage::ItemErrors SparseStructureFlowStage::errors(const data::StructureLatentBatch& latents,
                                                                      const Tensor& t, const Tensor& noise,
                                                                      const Tensor& noise_skl,
                                                                      const Tensor& condition) {
  const torch::Device device = parts_.device;
  const Tensor times = t.to(device), e = placed(noise), e_skl = placed(noise_skl);
  const Tensor x_0 = placed(latents.x_0), x_0_skl = placed(latents.x_0_skl);
  const double sigma = options_.sigma_min;
  const sparse_structure::Velocity velocity = parts_.model->forward(
      flow::noisy(x_0, e, times, sigma), flow::noisy(x_0_skl, e_skl, times, sigma), flow::model_time(times), condition);
  return {flow::mse_per_item(velocity.shape, flow::velocity_target(x_0, e, sigma)),
          flow::mse_per_item(velocity.skeleton, flow::velocity_target(x_0_skl, e_skl, sigma))};
}

Losses SparseStructureFlowStage::losses(const data::Batch& batch, const LossContext& context) {
  const auto& latents = dynamic_cast<const data::StructureLatentBatch&>(batch);
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
  const data::StructureLatentDataset& assets = *parts_.held_out;
  const std::size_t count = options_.eval_count(assets.size());
  const Tensor t = options_.eval_grid();
  const std::int64_t times = t.size(0);
  double mse = 0.0, mse_skl = 0.0;
  for (std::size_t i = 0; i < count; ++i) {
    const auto batch = assets.load({data::Draw{i, i}});
    auto latents = dynamic_cast<const data::StructureLatentBatch&>(*batch);
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

namespace {

const FlowConfigNames& structure_names() {
  static const FlowConfigNames names{{sparse_structure::kSparseStructureFlowClass},
                                     "AniGenImageConditionedFlowMatchingCFGTrainer",
                                     "ImageConditionedAniGenSparseStructureLatent",
                                     "AniGenSparseStructureLatent"};
  return names;
}

}  // namespace

std::unique_ptr<Stage> make_sparse_structure_flow_stage(const Json& config, const std::string& file,
                                                        ConfigReader& trainer_args, const TrainerOptions& trainer,
                                                        torch::Device device) {
  sparse_structure::SparseStructureFlowStageOptions options =
      sparse_structure::SparseStructureFlowStageOptions::read(trainer_args);
  options.seed = trainer.seed;
  auto parts = flow_parts<SparseStructureFlowStage>(config, file, trainer_args, trainer, device, structure_names());
  const data::StructureLatentOptions& reading = parts.data->options();
  if (const auto decoder = samples_decoder(reading.ss_dec_path, reading.ss_dec_ckpt,
                                           sparse_structure::kSparseStructureDecoderClass, "ss_dec_path", trainer)) {
    parts.decoder = nn::load_trained<sparse_structure::SparseStructureDecoder>(*decoder, device);
  }
  return std::make_unique<SparseStructureFlowStage>(options, std::move(parts));
}

using torch::Tensor;

flow::Streams SparseStructureFlowStage::drawn_sample(const flow::Streams& noise, const Tensor& condition, bool guided) {
  return flow::sample_flow(noise, sparse_structure::structure_velocities(parts_.model, condition, guided),
                           options_.sampler)
      .samples;
}

void SparseStructureFlowStage::sample(const std::filesystem::path& folder) {
  if (!parts_.decoder) return;
  const torch::NoGradGuard no_grad;
  const data::StructureLatentDataset& assets = shown_assets();
  const data::StructureLatentOptions& reading = assets.options();
  const auto decoded = [&](const Tensor& z, const Tensor& z_skl) {
    const auto latent = [&](const Tensor& x, const data::ChannelStatistics& statistics) {
      return data::denormalised(x.to(parts_.device, torch::kFloat32), statistics);
    };
    const auto logits =
        parts_.decoder->forward(latent(z, reading.normalization), latent(z_skl, reading.normalization_skl));
    const auto occupied = [](const Tensor& grid) { return (grid[0][0] > 0).to(torch::kCPU).contiguous(); };
    return sparse_structure::VoxelPair{occupied(logits.shape), occupied(logits.skeleton)};
  };
  std::vector<sparse_structure::VoxelSheetRow> rows;
  const std::size_t count = std::min(static_cast<std::size_t>(options_.sample_assets), assets.assets());
  for (std::size_t i = 0; i < count; ++i) {
    const auto batch = assets.load({data::Draw{assets.item_of(i), i}});  // each asset once, however often it repeats
    const auto& latents = dynamic_cast<const data::StructureLatentBatch&>(*batch);
    const at::Generator generator = nn::numbered_generator(options_.seed, "flow sample", i);
    const Tensor noise = torch::randn(latents.x_0.sizes(), generator);
    const Tensor noise_skl = torch::randn(latents.x_0_skl.sizes(), generator);
    const flow::Streams start{placed(noise), placed(noise_skl)};
    const Tensor condition = condition_of(latents.cond, 1);
    sparse_structure::VoxelSheetRow row;
    row.label = short_id(latents.ids.front());
    if (parts_.encoder) {
      row.picture = sparse_structure::picture_of_planes(latents.cond[0]);
      const flow::Streams guided = drawn_sample(start, condition, true);
      row.cells.push_back(decoded(guided[0], guided[1]));
    }
    const flow::Streams plain = drawn_sample(start, condition, false);
    row.cells.push_back(decoded(plain[0], plain[1]));
    row.cells.push_back(decoded(latents.x_0, latents.x_0_skl));
    rows.push_back(std::move(row));
  }
  const std::string truth = "latents of the asset, decoded";
  sparse_structure::write_voxel_sheet(folder / "samples.png", rows,
                                      parts_.encoder
                                          ? std::vector<std::string>{"sample, guided", "sample, not guided", truth}
                                          : std::vector<std::string>{"sample", truth});
}

}  // namespace anigen::train
