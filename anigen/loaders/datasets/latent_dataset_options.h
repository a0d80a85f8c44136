#pragma once
#include <torch/torch.h>

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "anigen/core/config_reader.h"
#include "anigen/loaders/files/latent_files.h"
#include "anigen/loaders/files/view_files.h"
#include "anigen/loaders/source_options.h"

namespace anigen::loaders {

/// What the `dataset.args` of AniGenSparseStructureLatent, AniGenSLat and their image-conditioned forms have in common
/// (reference training-and-data.md, 1.4): which latents, and which pictures condition the flow that learns them.
struct LatentDatasetOptions {
  SourceOptions sources;
  bool image_conditioned = false;  ///< by the name of the dataset, not an argument
  std::string latent_model;        ///< folder below ss_latents/ or latents/; required
  int image_size = 518;            ///< edge of the condition image; only when image-conditioned
  ConditionPictures condition = ConditionPictures::kColor;  ///< ours, `condition`: "color" or "normal"
  ChannelStatistics normalization, normalization_skl;       ///< empty: none; each class reads its own form of them

  /// Everything but the normalization. Rows need the column `flag` + latent_model, and `cond_rendered` when
  /// image-conditioned; no bad skeleton, no bad skin. @throws InputError
  void read_latents(ConfigReader& reader, bool conditioned, const std::string& flag);

  /// Adds the files that say whether an asset has condition pictures. @throws InputError when it should and has none
  void append_condition_files(const AssetId& asset, std::vector<std::filesystem::path>& files) const;
  /// One random view, chosen by (seed, position): [3, S, S] in [0, 1], on black; empty when not image-conditioned.
  std::vector<float> condition_picture(const AssetId& asset, std::uint64_t seed, std::uint64_t position) const;
  /// @param pictures of a batch @return [B, 3, S, S] fp32; undefined when not image-conditioned
  torch::Tensor condition_batch(const std::vector<const std::vector<float>*>& pictures,
                                const std::vector<std::string>& ids) const;
};

/// renders_cond/<id>
std::filesystem::path condition_folder(const AssetId& asset);

}  // namespace anigen::loaders
