#pragma once
#include <torch/torch.h>

#include <string>

#include "anigen/core/config_reader.h"
#include "anigen/loaders/datasets/asset_dataset.h"
#include "anigen/loaders/datasets/latent_dataset_options.h"

namespace anigen::loaders {

/// `dataset.args` of AniGenSparseStructureLatent and its image-conditioned form (reference training-and-data.md, 1.4).
/// Rows need `ss_latent_<latent_model>`. `normalization` and `normalization_skl` as dense_latent_statistics() reads
/// them.
struct StructureLatentOptions : LatentDatasetOptions {
  /// Which decoder turns samples into voxels for pictures; nothing here reads it. `pretrained_ss_dec`, the published
  /// name of one to download, is only warned of.
  std::string ss_dec_path, ss_dec_ckpt = "final";

  /// @throws InputError; also for normalization files that cannot be read
  static StructureLatentOptions read(ConfigReader& reader, bool image_conditioned);
};

struct StructureLatentBatch : Batch {
  torch::Tensor x_0;      ///< [B, 8, 16, 16, 16] fp32, latent of the surface's structure
  torch::Tensor x_0_skl;  ///< [B, 4, 16, 16, 16] fp32, of the skeleton's
  torch::Tensor cond;     ///< [B, 3, S, S] fp32 in [0, 1], on black; undefined when not image-conditioned
};

/// (ImageConditioned)AniGenSparseStructureLatent: what the first flow model learns to generate (paper 3.4). Reads
/// `ss_latents/<latent_model>/<id>.npz` and one random condition view.
class StructureLatentDataset : public AssetDataset {
 public:
  StructureLatentDataset(std::vector<AssetId> assets, const StructureLatentOptions& options, std::uint64_t seed);

  const StructureLatentOptions& options() const { return options_; }

 private:
  struct Latent;
  std::unique_ptr<Sample> read(std::size_t asset, std::uint64_t position) const override;
  std::unique_ptr<Batch> collate(const Samples& samples, const std::vector<std::string>& ids) const override;

  StructureLatentOptions options_;
};

}  // namespace anigen::loaders
