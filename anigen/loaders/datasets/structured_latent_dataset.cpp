#include "anigen/loaders/datasets/structured_latent_dataset.h"

#include <algorithm>

#include "anigen/loaders/balanced_groups.h"
#include "anigen/loaders/latent_normalization.h"

namespace anigen::loaders {
namespace {

namespace fs = std::filesystem;

fs::path structured_latent_path(const AssetId& asset, const std::string& model) {
  return asset.root / "latents" / model / (asset.id + ".npz");
}

std::vector<fs::path> files_of(const AssetId& asset, const StructuredLatentOptions& options) {
  std::vector<fs::path> files{structured_latent_path(asset, options.latent_model)};
  if (options.load_rigs || options.use_joint_num_cond) files.push_back(rig_path(asset));
  options.append_condition_files(asset, files);
  return files;
}

}  // namespace

StructuredLatentOptions StructuredLatentOptions::read(ConfigReader& reader, bool image_conditioned) {
  StructuredLatentOptions options;
  options.read_latents(reader, image_conditioned, "latent_");
  const StreamStatistics statistics = structured_latent_statistics(reader);
  options.normalization = statistics.shape;
  options.normalization_skl = statistics.skeleton;
  options.use_joint_num_cond = reader.boolean("use_joint_num_cond", false);
  options.load_rigs = reader.boolean("load_rigs", true);
  options.load_cubvh = reader.boolean("load_cubvh", false);
  if (options.load_cubvh && !options.load_rigs) throw reader.error("load_cubvh", "needs load_rigs");
  reader.ignore("max_num_voxels");
  options.voxel_limit = reader.integer("voxel_limit", 0, 0);
  if (options.voxel_limit > 0) options.sources.filter.max_num_voxels = options.voxel_limit;
  options.slat_dec_path = reader.text("slat_dec_path", "");
  options.slat_dec_ckpt = reader.text("slat_dec_ckpt", "final");
  options.bucket_by_voxels = reader.boolean("bucket_by_voxels", false);
  options.memory_budget_mb = reader.integer("memory_budget_mb", 8192, 0, 1 << 24);
  return options;
}

struct StructuredLatentDataset::Latent : Sample {
  VoxelRows surface, skeleton;
  RigArrays rig;  // without joints when no rigs are loaded
  std::int64_t joints = 0;
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
  if (options_.load_rigs) {
    sample->rig = read_rig_arrays(id);
    sample->joints = static_cast<std::int64_t>(sample->rig.joints.size());
    if (options_.load_cubvh) sample->solver = surfaces_.of(index, sample->rig);
  } else if (options_.use_joint_num_cond) {
    sample->joints = static_cast<std::int64_t>(count_rows(rig_path(id), "joints"));
  }
  sample->cond = options_.condition_picture(id, seed(), position);
  return sample;
}

std::unique_ptr<Batch> StructuredLatentDataset::collate(const Samples& samples,
                                                        const std::vector<std::string>& ids) const {
  auto batch = std::make_unique<StructuredLatentBatch>();
  std::vector<const VoxelRows*> surfaces, skeletons;
  std::vector<const std::vector<float>*> images;
  std::vector<std::int64_t> joints;
  for (const auto& sample : samples) {
    const auto& latent = static_cast<const Latent&>(*sample);
    surfaces.push_back(&latent.surface);
    skeletons.push_back(&latent.skeleton);
    images.push_back(&latent.cond);
    joints.push_back(latent.joints);
    if (options_.load_rigs) batch->rigs.append(latent.rig);
    if (latent.solver) batch->rigs.surfaces.push_back(latent.solver);
  }
  batch->x_0 = collate_voxels(surfaces, ids);
  batch->x_0_skl = collate_voxels(skeletons, ids);
  batch->cond = options_.condition_batch(images, ids);
  if (options_.use_joint_num_cond) batch->joints_num = torch::tensor(joints, torch::kInt64);
  return batch;
}

}  // namespace anigen::loaders
