#include "anigen/loaders/datasets/structure_latent_dataset.h"

#include "anigen/core/error.h"
#include "anigen/core/log.h"
#include "anigen/loaders/latent_normalization.h"
#include "anigen/loaders/ragged_voxels.h"

namespace anigen::loaders {
namespace {

namespace fs = std::filesystem;

fs::path structure_latent_path(const AssetId& asset, const std::string& model) {
  return asset.root / "ss_latents" / model / (asset.id + ".npz");
}

std::vector<fs::path> files_of(const AssetId& asset, const StructureLatentOptions& options) {
  std::vector<fs::path> files{structure_latent_path(asset, options.latent_model)};
  options.append_condition_files(asset, files);
  return files;
}

torch::Tensor latents(const std::vector<const LatentGrid*>& grids, const std::vector<std::string>& ids,
                      const char* name) {
  std::vector<const std::vector<float>*> values;
  for (std::size_t i = 0; i < grids.size(); ++i) {
    if (grids[i]->shape != grids[0]->shape) {
      throw InputError(ids[i], name, "is of another shape than that of " + ids[0] + ", in the same batch");
    }
    values.push_back(&grids[i]->values);
  }
  return stack(values, {grids[0]->shape.begin(), grids[0]->shape.end()}, ids, name);
}

}  // namespace

StructureLatentOptions StructureLatentOptions::read(ConfigReader& reader, bool image_conditioned) {
  StructureLatentOptions options;
  options.read_latents(reader, image_conditioned, "ss_latent_");
  options.normalization = dense_latent_statistics(reader, "normalization");
  options.normalization_skl = dense_latent_statistics(reader, "normalization_skl");
  options.ss_dec_path = reader.text("ss_dec_path", "");
  options.ss_dec_ckpt = reader.text("ss_dec_ckpt", "final");
  if (!reader.text("pretrained_ss_dec", "").empty()) {
    log::warn_once(reader.file() + ": " + reader.pointer_to("pretrained_ss_dec") +
                   " has no effect: nothing is fetched; ss_dec_path names the run that decodes samples");
  }
  return options;
}

struct StructureLatentDataset::Latent : Sample {
  StructureLatent latent;
  std::vector<float> cond;
};

StructureLatentDataset::StructureLatentDataset(std::vector<AssetId> assets, const StructureLatentOptions& options,
                                               std::uint64_t seed)
    : AssetDataset(std::move(assets), {seed, options.sources.skip_broken, false},
                   {[&](const AssetId& asset) { return files_of(asset, options); }, nullptr}),
      options_(options) {}

std::unique_ptr<AssetDataset::Sample> StructureLatentDataset::read(std::size_t index, std::uint64_t position) const {
  auto sample = std::make_unique<Latent>();
  const fs::path path = structure_latent_path(asset(index), options_.latent_model);
  StructureLatent& latent = sample->latent = read_structure_latent(path);
  const auto channels = [](const LatentGrid& grid) { return static_cast<std::size_t>(grid.shape[0]); };
  options_.normalization.normalize_planes(latent.mean.values, channels(latent.mean), path.string() + ": mean");
  options_.normalization_skl.normalize_planes(latent.mean_skl.values, channels(latent.mean_skl),
                                              path.string() + ": mean_skl");
  sample->cond = options_.condition_picture(asset(index), seed(), position);
  return sample;
}

std::unique_ptr<Batch> StructureLatentDataset::collate(const Samples& samples,
                                                       const std::vector<std::string>& ids) const {
  std::vector<const LatentGrid*> shapes, skeletons;
  std::vector<const std::vector<float>*> images;
  for (const auto& sample : samples) {
    const auto& latent = static_cast<const Latent&>(*sample);
    shapes.push_back(&latent.latent.mean);
    skeletons.push_back(&latent.latent.mean_skl);
    images.push_back(&latent.cond);
  }
  auto batch = std::make_unique<StructureLatentBatch>();
  batch->x_0 = latents(shapes, ids, "mean");
  batch->x_0_skl = latents(skeletons, ids, "mean_skl");
  batch->cond = options_.condition_batch(images, ids);
  return batch;
}

}  // namespace anigen::loaders
