#pragma once
#include <torch/torch.h>
#include <array>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "anigen/core/config.h"
#include "anigen/data/metadata.h"
#include "anigen/data/picture_cache.h"
#include "anigen/data/view_files.h"
#include "anigen/io/arrays/ndarray.h"
#include "anigen/nn/torch.h"

namespace anigen::data {

/// Expected shape and type of a member of a dataset's NPZ file.
struct ArraySpec {
  std::string name;
  std::vector<std::int64_t> shape;          ///< -1: any size
  std::size_t most = std::size_t{1} << 28;  ///< numbers at most, checked before they are read
};

/// Reads exactly these members, their headers first, so that a hostile size is refused before it is allocated.
/// @throws InputError naming file and array: missing members, another shape, too many numbers
io::NamedArrays read_arrays(const std::filesystem::path& path, const std::vector<ArraySpec>& specs);

/// The array of that name, of which there is one.
const io::NdArray& named(const io::NamedArrays& arrays, const std::string& name);

/// "name[i, j]": the place of one number, for messages.
std::string place_of(const std::string& name, const std::vector<std::int64_t>& shape, std::size_t flat);

/// All numbers, row-major. @throws InputError naming the first that is not finite
std::vector<float> finite_numbers(const io::NamedArrays& arrays, const std::string& name, const std::string& file);
/// @throws InputError when a number is no integer
std::vector<std::int64_t> whole_numbers(const io::NamedArrays& arrays, const std::string& name,
                                        const std::string& file);

/// A dense latent of the first stage.
struct LatentGrid {
  std::array<std::int64_t, 4> shape{};  ///< [C, r, r, r]
  std::vector<float> values;
};

/// `ss_latents/<model>/<id>.npz`.
struct StructureLatent {
  LatentGrid mean;      ///< [8, 16³] as published
  LatentGrid mean_skl;  ///< [4, 16³] as published
};

/// @throws InputError naming file and array: shapes that are no cubes or differ in r, numbers that are not finite
StructureLatent read_structure_latent(const std::filesystem::path& path);

/// Normalisation per channel, x ↦ (x − mean) / deviation. Empty: none.
struct ChannelStatistics {
  std::vector<float> mean, deviation;  ///< [C]

  bool empty() const { return mean.empty(); }
  /// @param values [C, count] @throws InputError when C differs @param what for messages
  void normalize_planes(std::vector<float>& values, std::size_t channels, const std::string& what) const;
  /// @param values [count, C]
  void normalize_rows(std::vector<float>& values, std::size_t channels, const std::string& what) const;
  /// @throws InputError when sizes differ, or a deviation is not positive and finite, or a mean is not finite
  void check(const std::string& file, const std::string& place) const;
};

/// Statistics of a dense latent in the arguments of a dataset. `key` is `normalization` or `normalization_skl`: the NPZ
/// that `anigen-encode ss` writes (as published; relative to the first root of `data_dir`, else to the working
/// directory), or, ours, an object of the lists `mean` and `std`. Missing, null or "": none. @throws InputError
ChannelStatistics dense_latent_statistics(ConfigReader& args, const std::string& key);

/// Normalises per channel. @param x [B, C, …] dense, or [N, C] rows of voxels
torch::Tensor normalised(const torch::Tensor& x, const ChannelStatistics& statistics);
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

/// Options that the `dataset.args` of AniGenSparseStructureLatent, AniGenSLat and their image-conditioned forms have in
/// common (docs/reference/training.md, 1.3): which latents, and which pictures condition the flow that learns them.
struct LatentDatasetOptions {
  SourceOptions sources;
  bool image_conditioned = false;  ///< by the name of the dataset, not an argument
  std::string latent_model;        ///< folder below ss_latents/ or latents/; required
  int image_size = 518;            ///< edge of the condition image; only when image-conditioned
  ConditionPictures condition = ConditionPictures::kColor;  ///< ours, `condition`: "color" or "normal"
  std::int64_t cache_mb = 0;  ///< ours: memory for decoded pictures, and as much for latents; 0: read for every draw
  ChannelStatistics normalization, normalization_skl;  ///< empty: none; each class reads its own form of them

  /// Memory of a cache of pictures or latents.
  std::uintmax_t cache_bytes() const { return static_cast<std::uintmax_t>(cache_mb) << 20; }
  /// Everything but the normalization. Rows need the column `flag` + latent_model, and `cond_rendered` when
  /// image-conditioned; no bad skeleton, no bad skin. @throws InputError
  void read_latents(ConfigReader& reader, bool conditioned, const std::string& flag);

  /// Adds the files that say whether an asset has condition pictures. @throws InputError when it should and has none
  void append_condition_files(const AssetId& asset, std::vector<std::filesystem::path>& files) const;
  /// One view, a random one chosen by (seed, position) unless it is given: [3, S, S] in [0, 1], on black; empty when
  /// not image-conditioned.
  std::vector<float> condition_picture(const AssetId& asset, std::uint64_t seed, std::uint64_t position,
                                       PictureCache& cache, std::optional<std::size_t> view = std::nullopt) const;
  /// @param pictures of a batch @return [B, 3, S, S] fp32; undefined when not image-conditioned
  torch::Tensor condition_batch(const std::vector<const std::vector<float>*>& pictures,
                                const std::vector<std::string>& ids) const;
};

}  // namespace anigen::data
