#include <algorithm>

#include "anigen/core/short_id.h"
#include "anigen/loaders/latent_normalization.h"
#include "anigen/models/sparse_structure_runs.h"
#include "anigen/models/sparse_structure_sampling.h"
#include "anigen/models/voxel_sheet.h"
#include "anigen/train/loss_generator.h"
#include "anigen/train/sparse_structure_flow_stage.h"

// What a run shows of itself; the loss is in sparse_structure_flow_stage.cpp.
namespace anigen::train {

using torch::Tensor;

flow::Streams SparseStructureFlowStage::drawn_sample(const flow::Streams& noise, const Tensor& condition, bool guided) {
  return flow::sample_flow(noise, models::structure_velocities(parts_.model, condition, guided), options_.sampler)
      .samples;
}

void SparseStructureFlowStage::sample(const std::filesystem::path& folder) {
  if (!parts_.decoder) return;
  const torch::NoGradGuard no_grad;
  const loaders::StructureLatentDataset& assets = shown_assets();
  const loaders::StructureLatentOptions& reading = assets.options();
  const auto decoded = [&](const Tensor& z, const Tensor& z_skl) {
    const auto latent = [&](const Tensor& x, const loaders::ChannelStatistics& statistics) {
      return loaders::denormalised(x.to(parts_.device, torch::kFloat32), statistics);
    };
    const auto logits =
        parts_.decoder->forward(latent(z, reading.normalization), latent(z_skl, reading.normalization_skl));
    const auto occupied = [](const Tensor& grid) { return (grid[0][0] > 0).to(torch::kCPU).contiguous(); };
    return models::VoxelPair{occupied(logits.shape), occupied(logits.skeleton)};
  };
  std::vector<models::VoxelSheetRow> rows;
  const std::size_t count = std::min(static_cast<std::size_t>(options_.sample_assets), assets.assets());
  for (std::size_t i = 0; i < count; ++i) {
    const auto batch = assets.load({loaders::Draw{assets.item_of(i), i}});  // each asset once, however often it repeats
    const auto& latents = dynamic_cast<const loaders::StructureLatentBatch&>(*batch);
    const at::Generator generator = nn::numbered_generator(options_.seed, "flow sample", i);
    const Tensor noise = torch::randn(latents.x_0.sizes(), generator);
    const Tensor noise_skl = torch::randn(latents.x_0_skl.sizes(), generator);
    const flow::Streams start{placed(noise), placed(noise_skl)};
    const Tensor condition = condition_of(latents.cond, 1);
    models::VoxelSheetRow row;
    row.label = short_id(latents.ids.front());
    if (parts_.encoder) {
      row.picture = models::picture_of_planes(latents.cond[0]);
      const flow::Streams guided = drawn_sample(start, condition, true);
      row.cells.push_back(decoded(guided[0], guided[1]));
    }
    const flow::Streams plain = drawn_sample(start, condition, false);
    row.cells.push_back(decoded(plain[0], plain[1]));
    row.cells.push_back(decoded(latents.x_0, latents.x_0_skl));
    rows.push_back(std::move(row));
  }
  const std::string truth = "latents of the asset, decoded";
  models::write_voxel_sheet(folder / "samples.png", rows,
                            parts_.encoder ? std::vector<std::string>{"sample, guided", "sample, not guided", truth}
                                           : std::vector<std::string>{"sample", truth});
}

}  // namespace anigen::train
