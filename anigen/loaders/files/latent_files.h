#pragma once
#include <array>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

namespace anigen::loaders {

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

/// Two arrays of an NPZ; dimensions of size 1 around the channels are allowed. @param lowest smaller deviations become
/// it
ChannelStatistics read_channel_statistics(const std::filesystem::path& path, const std::string& mean,
                                          const std::string& deviation, float lowest);

}  // namespace anigen::loaders
