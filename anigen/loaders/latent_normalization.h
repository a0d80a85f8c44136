#pragma once
#include <string>

#include "anigen/core/config_reader.h"
#include "anigen/core/json.h"
#include "anigen/loaders/files/latent_files.h"
#include "anigen/nn/torch.h"

namespace anigen::loaders {

/// Lists `mean<suffix>` and `std<suffix>` of numbers, one per channel; both missing: none. @throws InputError
ChannelStatistics listed_statistics(ConfigReader& reader, const std::string& suffix);

/// Statistics of a dense latent in the arguments of a dataset. `key` is `normalization` or `normalization_skl`: the NPZ
/// that `anigen-encode ss` writes (as published; relative to the first root of `data_dir`, else to the working
/// directory), or, ours, an object of the lists `mean` and `std`. Missing, null or "": none. @throws InputError
ChannelStatistics dense_latent_statistics(ConfigReader& args, const std::string& key);

/// Undoes a normalisation per channel. @param x [B, C, …] dense, or [N, C] rows of voxels
torch::Tensor denormalised(const torch::Tensor& x, const ChannelStatistics& statistics);

/// Statistics of both voxel sets of a structured latent.
struct StreamStatistics {
  ChannelStatistics shape;  ///< geometry channels, then skin
  ChannelStatistics skeleton;
};

/// `normalization` of structured latents: an object of the lists `mean`, `std`, `mean_skl` and `std_skl` (as published;
/// or, as the published pipeline also takes them, of objects {mean, std} called `slat` and `slat_skl`), or, ours, a
/// file that `anigen-encode slat` writes, found as above: its JSON normalises as the published config does, geometry
/// channels only; its NPZ normalises every channel. Missing, null or "": none.
/// @throws InputError
StreamStatistics structured_latent_statistics(ConfigReader& args);

/// Puts the numbers in the place of the files that the `dataset` of a config names for its latents, so that the config
/// in a run folder says by itself how its samples become latents again. Leaves other datasets as they are.
/// @param file the config, for messages @throws InputError
void write_out_statistics(Json& dataset, const std::string& file);

}  // namespace anigen::loaders
