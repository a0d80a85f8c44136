#include <algorithm>

#include "anigen/models/sparse_structure_runs.h"
#include "anigen/train/loss_generator.h"
#include "anigen/train/sparse_structure_flow_stage.h"
#include "anigen/train/voxel_sheet.h"

// What a run shows of itself; the loss is in sparse_structure_flow_stage.cpp.
namespace anigen::train {
namespace {

using torch::Tensor;

/// Undoes the dataset's normalisation. @param x [1, C, r, r, r] on the CPU
Tensor denormalised(const Tensor& x, const loaders::ChannelStatistics& statistics) {
  if (statistics.empty()) return x;
  const Tensor mean = torch::tensor(statistics.mean), deviation = torch::tensor(statistics.deviation);
  return x * deviation.view({1, -1, 1, 1, 1}) + mean.view({1, -1, 1, 1, 1});
}

/// [3, S, S] in [0, 1] as an opaque picture.
io::Image picture_of(const Tensor& planes) {
  const Tensor bytes = (planes.detach().to(torch::kCPU).clamp(0.0, 1.0) * 255.0 + 0.5).to(torch::kUInt8).contiguous();
  io::Image image(static_cast<int>(bytes.size(2)), static_cast<int>(bytes.size(1)));
  const std::uint8_t* values = bytes.data_ptr<std::uint8_t>();
  const std::size_t pixels = image.rgba.size() / 4;
  for (std::size_t i = 0; i < pixels; ++i) {
    for (std::size_t c = 0; c < 3; ++c) image.rgba[4 * i + c] = values[c * pixels + i];
  }
  return image;
}

}  // namespace

flow::Streams SparseStructureFlowStage::drawn_sample(const flow::Streams& noise, const Tensor& condition, bool guided) {
  const auto velocity_under = [this](const Tensor& tokens) {
    return [this, tokens](const flow::Streams& x, float time) {
      const Tensor t = torch::full({x[0].size(0)}, time, x[0].options());
      const models::Velocity velocity = parts_.model->forward(x[0], x[1], t, tokens);
      return flow::Streams{velocity.shape, velocity.skeleton};
    };
  };
  flow::Velocities velocities;
  velocities.conditional = velocity_under(condition);
  if (guided) velocities.unconditional = velocity_under(torch::zeros_like(condition));
  return flow::sample_euler(noise, velocities, options_.sampler).samples;
}

void SparseStructureFlowStage::sample(const std::filesystem::path& folder) {
  if (!parts_.decoder) return;
  const torch::NoGradGuard no_grad;
  const loaders::StructureLatentDataset& assets = parts_.held_out ? *parts_.held_out : *parts_.data;
  const loaders::StructureLatentOptions& reading = assets.options();
  const auto decoded = [&](const Tensor& z, const Tensor& z_skl) {
    const auto logits =
        parts_.decoder->forward(denormalised(z.to(torch::kCPU), reading.normalization).to(parts_.device),
                                denormalised(z_skl.to(torch::kCPU), reading.normalization_skl).to(parts_.device));
    const auto occupied = [](const Tensor& grid) { return (grid[0][0] > 0).to(torch::kCPU).contiguous(); };
    return VoxelPair{occupied(logits.shape), occupied(logits.skeleton)};
  };
  std::vector<VoxelSheetRow> rows;
  const std::size_t count = std::min(static_cast<std::size_t>(options_.sample_assets), assets.assets());
  for (std::size_t i = 0; i < count; ++i) {
    const auto batch = assets.load({loaders::Draw{assets.item_of(i), i}});  // each asset once, however often it repeats
    const auto& latents = dynamic_cast<const loaders::StructureLatentBatch&>(*batch);
    const at::Generator generator = numbered_generator(options_.seed, "flow sample", i);
    const Tensor noise = torch::randn(latents.x_0.sizes(), generator);
    const Tensor noise_skl = torch::randn(latents.x_0_skl.sizes(), generator);
    const flow::Streams start{noise.to(parts_.device), noise_skl.to(parts_.device)};
    const Tensor condition = condition_of(latents);
    VoxelSheetRow row;
    row.label = latents.ids.front();
    if (parts_.encoder) {
      row.picture = picture_of(latents.cond[0]);
      const flow::Streams guided = drawn_sample(start, condition, true);
      row.cells.push_back(decoded(guided[0], guided[1]));
    }
    const flow::Streams plain = drawn_sample(start, condition, false);
    row.cells.push_back(decoded(plain[0], plain[1]));
    row.cells.push_back(decoded(latents.x_0, latents.x_0_skl));
    rows.push_back(std::move(row));
  }
  const std::string truth = "latents of the asset, decoded";
  write_voxel_sheet(folder / "samples.png", rows,
                    parts_.encoder ? std::vector<std::string>{"sample, guided", "sample, not guided", truth}
                                   : std::vector<std::string>{"sample", truth});
}

}  // namespace anigen::train
