#include "anigen/loaders/datasets/feature_skeleton_dataset.h"

#include "anigen/core/log.h"
#include "anigen/core/random.h"
#include "anigen/loaders/files/pooled_voxels.h"
#include "anigen/loaders/files/skin_rows.h"
#include "anigen/loaders/files/view_files.h"

namespace anigen::loaders {
namespace {

namespace fs = std::filesystem;

fs::path feature_path(const AssetId& asset, const std::string& model) {
  return asset.root / "features" / model / (asset.id + ".npz");
}

fs::path view_folder(const AssetId& asset) { return asset.root / "renders" / asset.id; }

torch::Tensor matrices(std::vector<float> values, std::int64_t batch, std::int64_t edge) {
  return tensor_of(values, {batch, edge, edge});
}

}  // namespace

struct FeatureSkeletonDataset::Pack : Sample {
  VoxelRows features, skeleton;
  ViewImage view;
  RigArrays rig;
  std::shared_ptr<const geometry::NearestSurface> surface;
  bool is_bad_skin = false;
};

FeatureSkeletonDataset::FeatureSkeletonDataset(std::vector<AssetId> assets, const FeatureSkeletonOptions& options,
                                               std::uint64_t seed)
    : AssetDataset(std::move(assets), {seed, options.sources.skip_broken, options.bucket_by_voxels},
                   {[&](const AssetId& asset) {
                      return std::vector{feature_path(asset, options.model), skeleton_voxel_path(asset),
                                         view_folder(asset) / "transforms.json", rig_path(asset)};
                    },
                    options.bucket_by_voxels ? std::function<std::uint64_t(const AssetId&)>([&](const AssetId& asset) {
                      return count_rows(feature_path(asset, options.model), "indices");
                    })
                                             : nullptr}),
      options_(options),
      surfaces_(static_cast<std::uintmax_t>(options.memory_budget_mb) << 20) {}

std::vector<geometry::Voxel> FeatureSkeletonDataset::skeleton_voxels(const AssetId& asset,
                                                                     std::uint64_t position) const {
  const int radius = options_.skl_dilation_iter, resolution = options_.resolution;
  const std::vector<geometry::Voxel> rows = read_voxels_at(skeleton_voxel_path(asset), resolution);
  if (!options_.skl_dilation_random_aug) {
    return radius == 0 ? rows : geometry::dilate(rows, resolution, radius);
  }
  Rng rng(seed(), "skeleton dilation", position);
  if (!rng.chance(options_.skl_dilation_random_aug_prob)) return geometry::dilate(rows, resolution, radius);
  return geometry::dilate_randomly(rows, resolution, radius, [&rng] { return rng.uniform(); });
}

std::unique_ptr<AssetDataset::Sample> FeatureSkeletonDataset::read(std::size_t index, std::uint64_t position) const {
  const AssetId& id = asset(index);
  auto pack = std::make_unique<Pack>();
  pack->features = read_features_at(feature_path(id, options_.model), options_.resolution);
  pack->skeleton.coords = skeleton_voxels(id, position);
  Rng view(seed(), "view", position);
  pack->view = read_view(view_folder(id), options_.image_size, view);
  pack->rig = read_rig_arrays(id);
  const std::size_t unweighted = normalize_skin_rows(pack->rig.skin, pack->rig.joints.size());
  if (unweighted > 0 && !told_unweighted_.exchange(true)) {
    log::warn("{}: {} of {} vertices have no weight and follow joint 0, as published; said of the first such asset only",
              rig_path(id).string(), unweighted, pack->rig.vertices.size());
  }
  if (options_.skin_accum_as_flow) accumulate_skin_as_flow(pack->rig.skin, pack->rig.parents);
  if (options_.load_cubvh) pack->surface = surfaces_.of(index, pack->rig);
  pack->is_bad_skin = id.is_bad_skin;
  return pack;
}

std::unique_ptr<Batch> FeatureSkeletonDataset::collate(const Samples& samples,
                                                       const std::vector<std::string>& ids) const {
  auto batch = std::make_unique<FeatureSkeletonBatch>();
  std::vector<const VoxelRows*> features, skeletons;
  std::vector<const std::vector<float>*> images, alphas;
  std::vector<float> extrinsics, intrinsics;
  for (const auto& sample : samples) {
    const auto& pack = static_cast<const Pack&>(*sample);
    features.push_back(&pack.features);
    skeletons.push_back(&pack.skeleton);
    images.push_back(&pack.view.image);
    alphas.push_back(&pack.view.alpha);
    extrinsics.insert(extrinsics.end(), pack.view.extrinsics.begin(), pack.view.extrinsics.end());
    intrinsics.insert(intrinsics.end(), pack.view.intrinsics.begin(), pack.view.intrinsics.end());
    batch->rigs.append(pack.rig);
    if (pack.surface) batch->rigs.surfaces.push_back(pack.surface);
    batch->is_bad_skin.push_back(pack.is_bad_skin);
  }
  const std::int64_t edge = options_.image_size, count = static_cast<std::int64_t>(samples.size());
  batch->feats = collate_voxels(features, ids);
  batch->feats_skl = collate_voxels(skeletons, ids);
  batch->image = stack(images, {3, edge, edge}, ids, "image");
  batch->alpha = stack(alphas, {edge, edge}, ids, "alpha");
  batch->extrinsics = matrices(std::move(extrinsics), count, 4);
  batch->intrinsics = matrices(std::move(intrinsics), count, 3);
  return batch;
}

}  // namespace anigen::loaders
