#include "anigen/data/datasets.h"

#include <algorithm>
#include <atomic>
#include <set>
#include <system_error>
#include <type_traits>
#include <utility>

#include "anigen/core/config_fields.h"
#include "anigen/core/error.h"
#include "anigen/core/log.h"
#include "anigen/core/parallel.h"
#include "anigen/core/random.h"
#include "anigen/data/matting_dataset.h"
#include "anigen/data/picture_dataset.h"
#include "anigen/data/skin_correction_dataset.h"
#include "anigen/data/view_files.h"

namespace anigen::data {

namespace {

namespace fs = std::filesystem;

constexpr int kReplacements = 20;
constexpr const char* kSurfaceModel = "surface";  // features that begin with the way to the surface

// Only whether files are there: reading all of a large dataset would take hours.
std::string missing_file(const std::vector<fs::path>& files) {
  for (const fs::path& file : files) {
    std::error_code error;
    if (!fs::is_regular_file(file, error)) return InputError(file.string(), "", "no such file").what();
  }
  return "";
}

// Of what a model made of an asset. @param kind "features", "ss_latents" or "latents"
fs::path made_path(const AssetId& asset, const char* kind, const std::string& model) {
  return asset.root / kind / model / (asset.id + ".npz");
}

/// @throws InputError unless a dataset has this folder: of some assets there may be no file, but a misspelt name has
/// none
void require_folder(const AssetDataset& data, const fs::path& folder) {
  std::set<fs::path> roots;
  for (std::size_t i = 0; i < data.assets(); ++i) roots.insert(data.asset(i).root);
  for (const fs::path& root : roots) {
    std::error_code error;
    if (fs::is_directory(root / folder, error)) return;
  }
  throw InputError(roots.empty() ? "" : roots.begin()->string(), "seen_models", "no folder " + folder.string());
}

fs::path view_folder(const AssetId& asset) { return asset.root / "renders" / asset.id; }

std::vector<fs::path> files_of(const AssetId& asset, const StructureLatentOptions& options) {
  std::vector<fs::path> files{made_path(asset, "ss_latents", options.latent_model)};
  options.append_condition_files(asset, files);
  return files;
}

torch::Tensor latents(const std::vector<const LatentGrid*>& grids, const std::vector<std::string>& ids,
                      const char* name) {
  std::vector<const std::vector<float>*> values;
  for (std::size_t i = 0; i < grids.size(); ++i) {
    if (grids[i]->shape != grids[0]->shape)
      throw InputError(ids[i], name, "is of another shape than that of " + ids[0] + ", in the same batch");
    values.push_back(&grids[i]->values);
  }
  return stack(values, {grids[0]->shape.begin(), grids[0]->shape.end()}, ids, name);
}

using geometry::Voxel;

torch::Tensor occupancy_grids(const std::vector<const std::vector<Voxel>*>& sets, int resolution) {
  const std::int64_t r = resolution;
  torch::Tensor grids = torch::empty({static_cast<std::int64_t>(sets.size()), 1, r, r, r}, torch::kInt64);
  std::int64_t* grid = grids.data_ptr<std::int64_t>();
  std::fill_n(grid, grids.numel(), std::int64_t{0});
  for (const std::vector<Voxel>* voxels : sets) {
    for (const Voxel& v : *voxels) grid[(v[0] * r + v[1]) * r + v[2]] = 1;
    grid += r * r * r;
  }
  return grids;
}

std::vector<fs::path> structured_latent_files(const AssetId& asset, const StructuredLatentOptions& options) {
  std::vector<fs::path> files{made_path(asset, "latents", options.latent_model)};
  if (options.load_rigs || options.use_joint_num_cond) files.push_back(rig_path(asset));
  options.append_condition_files(asset, files);
  return files;
}

// AniGenSparseFeat2Skeleton: what the structured-latent auto-encoder learns from (paper 3.3;
// docs/reference/training.md, 1.3). Reads features, skeleton voxels, one random view and the rig of an asset; the first
// stage needs the rig only and reads the same folders through SkinDataset.
class FeatureSkeletonDataset : public AssetDataset {
 public:
  FeatureSkeletonDataset(std::vector<AssetId> assets, const FeatureSkeletonOptions& options, std::uint64_t seed)
      : AssetDataset(
            std::move(assets), {seed, options.sources.skip_broken, options.bucket_by_voxels},
            {[&](const AssetId& asset) {
               return std::vector{made_path(asset, "features", options.model), skeleton_voxel_path(asset),
                                  view_folder(asset) / "transforms.json", rig_path(asset)};
             },
             options.bucket_by_voxels ? std::function<std::uint64_t(const AssetId&)>([&](const AssetId& asset) {
               return count_rows(made_path(asset, "features", options.model), "indices");
             })
                                      : nullptr}),
        options_(options),
        surfaces_(static_cast<std::uintmax_t>(options.memory_budget_mb) << 20) {}

 private:
  struct Pack : Sample {
    VoxelRows features, skeleton;
    ViewImage view;
    RigArrays rig;
    std::shared_ptr<const geometry::NearestSurface> surface;
    bool is_bad_skin = false;
  };

  std::unique_ptr<Sample> read(std::size_t index, std::uint64_t position) const override {
    const AssetId& id = asset(index);
    auto pack = std::make_unique<Pack>();
    pack->features = read_features_at(made_path(id, "features", options_.model), options_.resolution);
    if (options_.support_noise.any()) {
      Rng noise(seed(), "support noise", position);
      pack->features = with_support_noise(pack->features, options_.resolution, options_.support_noise,
                                          options_.model == kSurfaceModel ? 3 : 0, noise);
    }
    pack->skeleton.coords = skeleton_voxels(id, position);
    Rng view(seed(), "view", position);
    pack->view = read_view(view_folder(id), options_.image_size, view);
    pack->rig = read_rig_arrays(id);
    const std::size_t unweighted = normalize_skin_rows(pack->rig.skin, pack->rig.joints.size());
    if (unweighted > 0 && !told_unweighted_.exchange(true)) {
      log::warn(
          "{}: {} of {} vertices have no weight and follow joint 0, as published; said of the first such asset only",
          rig_path(id).string(), unweighted, pack->rig.vertices.size());
    }
    if (options_.skin_accum_as_flow) accumulate_skin_as_flow(pack->rig.skin, pack->rig.parents);
    if (options_.load_cubvh) pack->surface = surfaces_.of(index, pack->rig);
    pack->is_bad_skin = id.is_bad_skin;
    return pack;
  }
  std::unique_ptr<Batch> collate(const Samples& samples, const std::vector<std::string>& ids) const override {
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
    batch->extrinsics = tensor_of(extrinsics, {count, 4, 4});
    batch->intrinsics = tensor_of(intrinsics, {count, 3, 3});
    return batch;
  }
  std::vector<geometry::Voxel> skeleton_voxels(const AssetId& asset, std::uint64_t position) const {
    const int radius = options_.skl_dilation_iter, resolution = options_.resolution;
    const std::vector<geometry::Voxel> rows = read_voxels_at(skeleton_voxel_path(asset), resolution);
    if (!options_.skl_dilation_random_aug) return radius == 0 ? rows : geometry::dilate(rows, resolution, radius);
    Rng rng(seed(), "skeleton dilation", position);
    if (!rng.chance(options_.skl_dilation_random_aug_prob)) return geometry::dilate(rows, resolution, radius);
    return geometry::dilate_randomly(rows, resolution, radius, [&rng] { return rng.uniform(); });
  }

  FeatureSkeletonOptions options_;
  mutable SurfaceCache surfaces_;
  mutable std::atomic<bool> told_unweighted_{false};
};

using Factory = std::function<Datasets(ConfigReader&, std::uint64_t)>;

// Options of held-out assets.
template <typename Options>
Options without_noise(Options options) {
  if constexpr (std::is_same_v<Options, FeatureSkeletonOptions>) {
    options.support_noise = {};
    options.skl_dilation_random_aug = false;
  }
  if constexpr (std::is_same_v<Options, PictureOptions>) options.light = 0.0;
  if constexpr (std::is_same_v<Options, MattingOptions>) options.picture_share = 0.0;
  if constexpr (std::is_same_v<Options, StructuredLatentOptions>) options.seen_models.clear();
  return options;
}

template <typename Dataset, typename Options, typename... Extra>
Factory factory(Extra... extra) {
  return [=](ConfigReader& args, std::uint64_t seed) {
    const Options options = Options::read(args, extra...), of_eval = without_noise(options);
    args.finish();
    TrainingData assets =
        open_training(options.sources, [options, seed](std::vector<AssetId> chosen, const BatchSource*) {
          return std::make_shared<Dataset>(std::move(chosen), options, seed);
        });
    Datasets datasets;
    datasets.train = assets.train;
    if (!assets.eval.empty()) datasets.eval = std::make_shared<const Dataset>(std::move(assets.eval), of_eval, seed);
    return datasets;
  };
}

const std::vector<std::pair<std::string, Factory>>& registry() {
  static const std::vector<std::pair<std::string, Factory>> entries{
      {"AniGenSparseStructure", factory<SparseStructureDataset, SparseStructureOptions>()},
      {"AniGenSparseFeat2Skeleton", factory<FeatureSkeletonDataset, FeatureSkeletonOptions>()},
      {"AniGenSparseStructureLatent", factory<StructureLatentDataset, StructureLatentOptions>(false)},
      {"ImageConditionedAniGenSparseStructureLatent", factory<StructureLatentDataset, StructureLatentOptions>(true)},
      {"AniGenMattings", factory<MattingDataset, MattingOptions>()},
      {"AniGenPictures", factory<PictureDataset, PictureOptions>()},
      {"AniGenSkinCorrections", open_skin_corrections},
      {"AniGenSLat", factory<StructuredLatentDataset, StructuredLatentOptions>(false)},
      {"AniGenImageConditionedSLat", factory<StructuredLatentDataset, StructuredLatentOptions>(true)}};
  return entries;
}

// Listed in the published registry without an implementation, or for text conditions, which no released model has.
constexpr const char* kUnimplemented[] = {"AniGenSparseFeat2Render", "AniGenTextConditionedSLat", "TextConditionedSLat",
                                          "TextConditionedAniGenSparseStructureLatent"};

}  // namespace

AssetDataset::AssetDataset(std::vector<AssetId> assets, const Options& options, const Files& files)
    : options_(options) {
  std::vector<std::string> problems(assets.size());
  std::vector<std::uint64_t> voxels(assets.size(), 0);
  parallel_for(assets.size(), [&](std::size_t i) {
    try {
      problems[i] = missing_file(files.of(assets[i]));
      if (!problems[i].empty() || !files.count_voxels) return;
      voxels[i] = assets[i].num_voxels > 0 ? assets[i].num_voxels : files.count_voxels(assets[i]);
    } catch (const InputError& error) {
      problems[i] = error.what();
    }
  });
  std::vector<std::string> named;
  for (std::size_t i = 0; i < assets.size(); ++i) {
    if (!problems[i].empty()) {
      named.push_back(problems[i]);
      continue;
    }
    visits_.insert(visits_.end(), assets[i].repeat, assets_.size());
    assets_.push_back(std::move(assets[i]));
    if (files.count_voxels) voxels_.push_back(voxels[i]);
  }
  report_broken(named, problems.size(), options.skip_broken);
}

std::size_t AssetDataset::item_of(std::size_t asset) const {
  // The visits of an asset follow each other, in the order of assets.
  return static_cast<std::size_t>(std::lower_bound(visits_.begin(), visits_.end(), asset) - visits_.begin());
}

std::unique_ptr<Batch> AssetDataset::load(const std::vector<Draw>& draws) const {
  Samples samples;
  std::vector<std::string> ids;
  for (const Draw& draw : draws) {
    samples.push_back(sample(draw));
    ids.push_back(samples.back()->id);
  }
  std::unique_ptr<Batch> batch = collate(samples, ids);
  batch->ids = std::move(ids);
  return batch;
}

std::unique_ptr<AssetDataset::Sample> AssetDataset::sample(const Draw& draw) const {
  std::size_t asset = visits_[draw.item];
  Rng replacement(options_.seed, "replacement", draw.position);
  for (int attempt = 0;; ++attempt) {
    try {
      std::unique_ptr<Sample> found = read(asset, draw.position);
      found->id = assets_[asset].id;
      return found;
    } catch (const InputError& error) {
      if (!options_.skip_broken) throw;
      broken_.note(assets_[asset].id, error.what());
      if (attempt == kReplacements) {
        throw InputError("", "dataset",
                         std::to_string(broken().size()) + " assets cannot be read, the last " +
                             std::to_string(kReplacements + 1) + " in a row; the last error: " + error.what());
      }
      asset = visits_[replacement.index(visits_.size())];
    }
  }
}

std::vector<std::uint64_t> AssetDataset::bucket_loads() const {
  std::vector<std::uint64_t> loads;
  if (!options_.bucket_by_voxels) return loads;
  for (std::size_t item = 0; item < visits_.size(); ++item) loads.push_back(voxels_of_item(item));
  return loads;
}

FeatureSkeletonOptions FeatureSkeletonOptions::read(ConfigReader& reader) {
  FeatureSkeletonOptions options;
  options.sources.read_common(reader);
  ConfigFields f(reader);
  f("image_size", options.image_size, {1, 4096}, kRequired);
  f("model", options.model);
  f("resolution", options.resolution, {1, kStoredResolution});
  if (kStoredResolution % options.resolution != 0) throw reader.error("resolution", "must divide 64");
  f("load_cubvh", options.load_cubvh);
  f("skl_dilation_iter", options.skl_dilation_iter, {0, kMostResolution});
  f("skl_dilation_random_aug", options.skl_dilation_random_aug);
  f("skl_dilation_random_aug_prob", options.skl_dilation_random_aug_prob, {0.0, 1.0});
  f("support_grow", options.support_noise.grow, {0.0, 1.0});
  f("support_drop", options.support_noise.drop, {0.0, 0.99});
  f("skin_accum_as_flow", options.skin_accum_as_flow);
  f.ignored("joint_merge_res");
  f("bucket_by_voxels", options.bucket_by_voxels);
  f("memory_budget_mb", options.memory_budget_mb, {0, 1 << 24});
  options.sources.filter.required_flags = {"feature_" + options.model};
  options.sources.filter.required_columns = {"is_bad_skin"};
  options.sources.filter.read_rigged(reader);
  return options;
}

StructureLatentOptions StructureLatentOptions::read(ConfigReader& reader, bool image_conditioned) {
  StructureLatentOptions options;
  options.read_latents(reader, image_conditioned, "ss_latent_");
  options.normalization = dense_latent_statistics(reader, "normalization");
  options.normalization_skl = dense_latent_statistics(reader, "normalization_skl");
  ConfigFields f(reader);
  f("ss_dec_path", options.ss_dec_path);
  f("ss_dec_ckpt", options.ss_dec_ckpt);
  if (!reader.text("pretrained_ss_dec", "").empty()) {
    log::warn_once(reader.file() + ": " + reader.pointer_to("pretrained_ss_dec") +
                   " has no effect: nothing is fetched; ss_dec_path names the run that decodes samples");
  }
  return options;
}

struct StructureLatentDataset::Latent : Sample {
  std::shared_ptr<const StructureLatent> latent;
  std::vector<float> cond;
};

StructureLatentDataset::StructureLatentDataset(std::vector<AssetId> assets, const StructureLatentOptions& options,
                                               std::uint64_t seed)
    : AssetDataset(std::move(assets), {seed, options.sources.skip_broken, false},
                   {[&](const AssetId& asset) { return files_of(asset, options); }, nullptr}),
      options_(options),
      pictures_(options.cache_bytes()),
      latents_(options.cache_bytes()) {}

StructureLatent StructureLatentDataset::normalized(const fs::path& path) const {
  StructureLatent latent = read_structure_latent(path);
  const auto channels = [](const LatentGrid& grid) { return static_cast<std::size_t>(grid.shape[0]); };
  options_.normalization.normalize_planes(latent.mean.values, channels(latent.mean), path.string() + ": mean");
  options_.normalization_skl.normalize_planes(latent.mean_skl.values, channels(latent.mean_skl),
                                              path.string() + ": mean_skl");
  return latent;
}

std::unique_ptr<AssetDataset::Sample> StructureLatentDataset::read(std::size_t index, std::uint64_t position) const {
  auto sample = std::make_unique<Latent>();
  const fs::path path = made_path(asset(index), "ss_latents", options_.latent_model);
  sample->latent = latents_.get(
      path.string(), [&] { return normalized(path); },
      [](const StructureLatent& latent) {
        return (latent.mean.values.size() + latent.mean_skl.values.size()) * sizeof(float);
      });
  sample->cond = options_.condition_picture(asset(index), seed(), position, pictures_);
  return sample;
}

std::unique_ptr<Batch> StructureLatentDataset::collate(const Samples& samples,
                                                       const std::vector<std::string>& ids) const {
  std::vector<const LatentGrid*> shapes, skeletons;
  std::vector<const std::vector<float>*> images;
  for (const auto& sample : samples) {
    const auto& latent = static_cast<const Latent&>(*sample);
    shapes.push_back(&latent.latent->mean);
    skeletons.push_back(&latent.latent->mean_skl);
    images.push_back(&latent.cond);
  }
  auto batch = std::make_unique<StructureLatentBatch>();
  batch->x_0 = latents(shapes, ids, "mean");
  batch->x_0_skl = latents(skeletons, ids, "mean_skl");
  batch->cond = options_.condition_batch(images, ids);
  return batch;
}

SparseStructureOptions SparseStructureOptions::read(ConfigReader& reader) {
  SparseStructureOptions options;
  options.sources.read_common(reader);
  options.sources.filter.required_flags = {"voxelized"};
  options.sources.filter.drop_bad_skeleton = false;
  ConfigFields f(reader);
  f("resolution", options.resolution, {1, kMostResolution});
  f("skl_dilation_iter", options.skl_dilation_iter, {0, kMostResolution});
  return options;
}

struct SparseStructureDataset::Occupancy : Sample {
  std::vector<Voxel> surface, skeleton;
};

SparseStructureDataset::SparseStructureDataset(std::vector<AssetId> assets, const SparseStructureOptions& options,
                                               std::uint64_t seed)
    : AssetDataset(std::move(assets), {seed, options.sources.skip_broken, false},
                   {[](const AssetId& asset) {
                      return std::vector{surface_voxel_path(asset), skeleton_voxel_path(asset)};
                    },
                    nullptr}),
      options_(options) {}

std::unique_ptr<AssetDataset::Sample> SparseStructureDataset::read(std::size_t index, std::uint64_t) const {
  auto sample = std::make_unique<Occupancy>();
  sample->surface = read_voxel_rows(surface_voxel_path(asset(index)), options_.resolution);
  sample->skeleton = geometry::dilate(read_voxel_rows(skeleton_voxel_path(asset(index)), options_.resolution),
                                      options_.resolution, options_.skl_dilation_iter);
  return sample;
}

std::unique_ptr<Batch> SparseStructureDataset::collate(const Samples& samples, const std::vector<std::string>&) const {
  std::vector<const std::vector<Voxel>*> surfaces, skeletons;
  for (const auto& sample : samples) {
    const auto& occupancy = static_cast<const Occupancy&>(*sample);
    surfaces.push_back(&occupancy.surface);
    skeletons.push_back(&occupancy.skeleton);
  }
  auto batch = std::make_unique<SparseStructureBatch>();
  batch->ss = occupancy_grids(surfaces, options_.resolution);
  batch->ss_skl = occupancy_grids(skeletons, options_.resolution);
  return batch;
}

StructuredLatentOptions StructuredLatentOptions::read(ConfigReader& reader, bool image_conditioned) {
  StructuredLatentOptions options;
  options.read_latents(reader, image_conditioned, "latent_");
  const StreamStatistics statistics = structured_latent_statistics(reader);
  options.normalization = statistics.shape;
  options.normalization_skl = statistics.skeleton;
  ConfigFields f(reader);
  f("use_joint_num_cond", options.use_joint_num_cond);
  f("load_rigs", options.load_rigs);
  f("load_cubvh", options.load_cubvh);
  if (options.load_cubvh && !options.load_rigs) throw reader.error("load_cubvh", "needs load_rigs");
  f.ignored("max_num_voxels");
  f("voxel_limit", options.voxel_limit, {0});
  if (options.voxel_limit > 0) options.sources.filter.max_num_voxels = options.voxel_limit;
  f("slat_dec_path", options.slat_dec_path);
  f("slat_dec_ckpt", options.slat_dec_ckpt);
  f("bucket_by_voxels", options.bucket_by_voxels);
  f("memory_budget_mb", options.memory_budget_mb, {0, 1 << 24});
  options.seen_models = reader.texts("seen_models", {});
  f("seen_share", options.seen_share, {0.0, 1.0});
  return options;
}

struct StructuredLatentDataset::Latent : Sample {
  std::shared_ptr<const VoxelPair> voxels;
  RigArrays rig;  // without joints when no rigs are loaded
  std::int64_t joints = 0;
  std::shared_ptr<const geometry::NearestSurface> solver;
  std::vector<float> cond;
};

StructuredLatentDataset::StructuredLatentDataset(std::vector<AssetId> assets, const StructuredLatentOptions& options,
                                                 std::uint64_t seed)
    : AssetDataset(std::move(assets), {seed, options.sources.skip_broken, options.bucket_by_voxels},
                   {[&](const AssetId& asset) { return structured_latent_files(asset, options); },
                    [&](const AssetId& asset) {
                      return count_rows(made_path(asset, "latents", options.latent_model), "coords");
                    }}),
      options_(options),
      surfaces_(static_cast<std::uintmax_t>(options.memory_budget_mb) << 20),
      pictures_(options.cache_bytes()),
      latents_(options.cache_bytes()) {
  for (const std::string& model : options_.seen_models) require_folder(*this, fs::path("latents") / model);
}

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

StructuredLatentDataset::VoxelPair StructuredLatentDataset::normalized(const fs::path& path, bool seen) const {
  VoxelPair pair{read_voxel_arrays(path, "coords", "feats"), read_voxel_arrays(path, "coords_skl", "feats_skl"), {}};
  if (seen && options_.image_conditioned) {
    const std::int64_t view = whole_numbers(read_arrays(path, {{"view", {1}}}), "view", path.string()).front();
    if (view < 0) throw InputError(path.string(), "view", "must not be negative");
    pair.view = static_cast<std::size_t>(view);
  }
  options_.normalization.normalize_rows(pair.surface.feats, pair.surface.channels, path.string() + ": feats");
  options_.normalization_skl.normalize_rows(pair.skeleton.feats, pair.skeleton.channels, path.string() + ": feats_skl");
  return pair;
}

std::shared_ptr<const StructuredLatentDataset::VoxelPair> StructuredLatentDataset::latents_of(
    const AssetId& asset, std::uint64_t position) const {
  fs::path path = made_path(asset, "latents", options_.latent_model);
  bool seen = false;
  if (!options_.seen_models.empty()) {
    Rng rng(seed(), "seen latents", position);
    const bool wanted = rng.chance(options_.seen_share);
    const fs::path other = made_path(asset, "latents", options_.seen_models[rng.index(options_.seen_models.size())]);
    std::error_code error;
    seen = wanted && fs::is_regular_file(other, error);
    if (seen) path = other;
  }
  return latents_.get(
      path.string(), [&] { return normalized(path, seen); },
      [](const VoxelPair& pair) {
        const auto bytes = [](const VoxelRows& rows) {
          return rows.feats.size() * sizeof(rows.feats[0]) + rows.coords.size() * sizeof(rows.coords[0]);
        };
        return bytes(pair.surface) + bytes(pair.skeleton);
      });
}

std::unique_ptr<AssetDataset::Sample> StructuredLatentDataset::read(std::size_t index, std::uint64_t position) const {
  const AssetId& id = asset(index);
  auto sample = std::make_unique<Latent>();
  sample->voxels = latents_of(id, position);
  if (options_.load_rigs) {
    sample->rig = read_rig_arrays(id);
    sample->joints = static_cast<std::int64_t>(sample->rig.joints.size());
    if (options_.load_cubvh) sample->solver = surfaces_.of(index, sample->rig);
  } else if (options_.use_joint_num_cond) {
    sample->joints = static_cast<std::int64_t>(count_rows(rig_path(id), "joints"));
  }
  sample->cond = options_.condition_picture(id, seed(), position, pictures_, sample->voxels->view);
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
    surfaces.push_back(&latent.voxels->surface);
    skeletons.push_back(&latent.voxels->skeleton);
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

std::vector<std::string> dataset_names() {
  std::vector<std::string> all;
  for (const auto& entry : registry()) all.push_back(entry.first);
  return all;
}

Datasets make_datasets(ConfigReader dataset, std::uint64_t seed) {
  dataset.require("name");
  const std::string name = dataset.text("name", "");
  ConfigReader args = dataset.object("args");
  dataset.finish();
  for (const auto& [known, make] : registry()) {
    if (known == name) return make(args, seed);
  }
  for (const char* other : kUnimplemented) {
    if (name == other) throw NotSupportedError(dataset.file(), dataset.pointer_to("name"), "dataset '" + name + "'");
  }
  throw dataset.error("name", "unknown dataset '" + name.substr(0, 80) + "'; " + suggestion(name, dataset_names()));
}

}  // namespace anigen::data
