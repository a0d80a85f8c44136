#include "anigen/loaders/datasets/structured_latent_dataset.h"

#include <algorithm>

#include "anigen/core/random.h"
#include "anigen/loaders/balanced_groups.h"
#include "anigen/loaders/datasets/structure_latent_dataset.h"
#include "anigen/loaders/files/view_files.h"
#include "anigen/loaders/latent_normalization.h"

namespace anigen::loaders {
namespace {

namespace fs = std::filesystem;

fs::path structured_latent_path(const AssetId& asset, const std::string& model) {
  return asset.root / "latents" / model / (asset.id + ".npz");
}

std::vector<fs::path> files_of(const AssetId& asset, const StructuredLatentOptions& options) {
  std::vector<fs::path> files{structured_latent_path(asset, options.latent_model), rig_path(asset)};
  if (options.image_conditioned) files.push_back(condition_folder(asset) / "transforms.json");
  return files;
}

}  // namespace

StructuredLatentOptions StructuredLatentOptions::read(ConfigReader& reader, bool image_conditioned) {
  StructuredLatentOptions options;
  options.image_conditioned = image_conditioned;
  options.sources.read_common(reader);
  reader.require("latent_model");
  options.latent_model = reader.text("latent_model", "");
  if (image_conditioned) options.image_size = static_cast<int>(reader.integer("image_size", 518, 1, 4096));
  options.use_joint_num_cond = reader.boolean("use_joint_num_cond", false);
  options.load_cubvh = reader.boolean("load_cubvh", false);
  reader.ignore("max_num_voxels");
  if (const Json* given = reader.raw("normalization"); given != nullptr && !given->is_null()) {
    ConfigReader normalization = reader.object("normalization");
    options.normalization = listed_statistics(normalization, "");
    options.normalization_skl = listed_statistics(normalization, "_skl");
    normalization.finish();
  }
  options.slat_dec_path = reader.text("slat_dec_path", "");
  options.slat_dec_ckpt = reader.text("slat_dec_ckpt", "final");
  options.bucket_by_voxels = reader.boolean("bucket_by_voxels", false);
  options.memory_budget_mb = reader.integer("memory_budget_mb", 8192, 0, 1 << 24);

  RowFilter& filter = options.sources.filter;
  filter.required_flags = {"latent_" + options.latent_model};
  if (image_conditioned) filter.required_flags.push_back("cond_rendered");
  filter.drop_bad_skin = true;
  return options;
}

struct StructuredLatentDataset::Latent : Sample {
  VoxelRows surface, skeleton;
  RigArrays rig;
  std::shared_ptr<const geometry::NearestSurface> solver;
  std::vector<float> cond;
};

StructuredLatentDataset::StructuredLatentDataset(std::vector<AssetId> assets, const StructuredLatentOptions& options,
                                                 std::uint64_t seed)
    : AssetDataset(std::move(assets), {seed, options.sources.skip_broken, options.bucket_by_voxels},
                   {[&](const AssetId& asset) { return files_of(asset, options); },
                    [&](const AssetId& asset) {
                      return count_rows(structured_latent_path(asset, options.latent_model), "coords");
                    }}),
      options_(options),
      surfaces_(static_cast<std::uintmax_t>(options.memory_budget_mb) << 20) {}

std::vector<std::vector<Draw>> StructuredLatentDataset::split(const std::vector<Draw>& draws, std::size_t parts) const {
  std::vector<std::uint64_t> loads;
  for (const Draw& draw : draws) loads.push_back(std::max<std::uint64_t>(1, voxels_of_item(draw.item)));
  std::vector<std::vector<Draw>> packs;
  for (const auto& group : balanced_groups(loads, std::max<std::size_t>(1, std::min(parts, draws.size())))) {
    packs.emplace_back();
    for (const std::size_t i : group) packs.back().push_back(draws[i]);
  }
  return packs;
}

std::unique_ptr<AssetDataset::Sample> StructuredLatentDataset::read(std::size_t index, std::uint64_t position) const {
  const AssetId& id = asset(index);
  auto sample = std::make_unique<Latent>();
  const fs::path path = structured_latent_path(id, options_.latent_model);
  sample->surface = read_voxel_arrays(path, "coords", "feats");
  sample->skeleton = read_voxel_arrays(path, "coords_skl", "feats_skl");
  options_.normalization.normalize_rows(sample->surface.feats, sample->surface.channels, path.string() + ": feats");
  options_.normalization_skl.normalize_rows(sample->skeleton.feats, sample->skeleton.channels,
                                            path.string() + ": feats_skl");
  sample->rig = read_rig_arrays(id);
  if (options_.load_cubvh) sample->solver = surfaces_.of(index, sample->rig);
  if (options_.image_conditioned) {
    Rng view(seed(), "condition view", position);
    sample->cond = read_condition_image(condition_folder(id), options_.image_size, view);
  }
  return sample;
}

std::unique_ptr<Batch> StructuredLatentDataset::collate(const Samples& samples,
                                                        const std::vector<std::string>& ids) const {
  auto batch = std::make_unique<StructuredLatentBatch>();
  std::vector<const VoxelRows*> surfaces, skeletons;
  std::vector<const std::vector<float>*> images;
  for (const auto& sample : samples) {
    const auto& latent = static_cast<const Latent&>(*sample);
    surfaces.push_back(&latent.surface);
    skeletons.push_back(&latent.skeleton);
    images.push_back(&latent.cond);
    batch->rigs.append(latent.rig);
    if (latent.solver) batch->rigs.surfaces.push_back(latent.solver);
  }
  batch->x_0 = collate_voxels(surfaces, ids);
  batch->x_0_skl = collate_voxels(skeletons, ids);
  if (options_.image_conditioned)
    batch->cond = stack(images, {3, options_.image_size, options_.image_size}, ids, "cond");
  if (options_.use_joint_num_cond) {
    batch->joints_num = torch::empty({static_cast<std::int64_t>(samples.size())}, torch::kInt64);
    auto* out = batch->joints_num.data_ptr<std::int64_t>();
    for (const torch::Tensor& joints : batch->rigs.joints) *out++ = joints.size(0);
  }
  return batch;
}

}  // namespace anigen::loaders
