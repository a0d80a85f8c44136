#pragma once
#include <cstddef>
#include <filesystem>
#include <string>
#include <vector>

#include "anigen/core/json.h"
#include "anigen/io/ndarray.h"

namespace anigen::pipeline {

/// The mean and the mean square of one latent per channel.
struct LatentMoments {
  std::vector<double> mean, mean_square;
};

/// @param values [C, count] or any more dimensions behind C @throws InputError when there are none, or they do not
/// divide into C channels
LatentMoments moments_of(const std::vector<float>& values, std::size_t channels, const std::string& name);
Json to_json(const LatentMoments& moments);
LatentMoments latent_moments_from_json(const Json& json);

/// Mean and deviation of latents per channel: each asset's mean and mean square, averaged over assets, so that large
/// assets do not count more; deviation √(E[x²] − E[x]²) (reference training-and-data.md, 1.3).
class LatentStatistics {
 public:
  /// @throws InputError when the number of channels differs from earlier assets'
  void add(const LatentMoments& moments, const std::string& name);

  std::size_t assets() const { return assets_; }
  std::vector<float> mean() const;
  std::vector<float> deviation() const;
  /// Channels with the same value everywhere, up to the rounding of these sums: nothing can be divided by their
  /// deviation.
  std::vector<std::size_t> constant_channels() const;

 private:
  std::vector<double> sum_, sum_of_squares_;
  std::size_t assets_ = 0;
};

/// `<prefix>_mean` and `<prefix>_std`, as a dataset's `normalization` argument wants them.
void append_arrays(io::NamedArrays& arrays, const std::string& prefix, const LatentStatistics& statistics);
Json to_json(const LatentStatistics& statistics);

}  // namespace anigen::pipeline
