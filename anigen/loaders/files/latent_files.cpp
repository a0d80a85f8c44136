#include "anigen/loaders/files/latent_files.h"

#include <algorithm>
#include <cmath>

#include "anigen/core/error.h"
#include "anigen/io/npz.h"
#include "anigen/loaders/files/npz_arrays.h"

namespace anigen::loaders {
namespace {

LatentGrid grid(const io::NamedArrays& arrays, const std::string& name, const std::string& file) {
  const std::vector<std::int64_t>& shape = named(arrays, name).shape;
  if (shape[1] != shape[2] || shape[1] != shape[3] || shape[0] == 0 || shape[1] == 0) {
    throw InputError(file, name, "is not of the shape [C, r, r, r]");
  }
  LatentGrid latent;
  std::copy_n(shape.begin(), 4, latent.shape.begin());
  latent.values = finite_numbers(arrays, name, file);
  return latent;
}

std::vector<float> channels(const io::NamedArrays& arrays, const std::string& name, const std::string& file) {
  const io::NdArray* array = io::find(arrays, name);
  if (array == nullptr) throw InputError(file, name, "no such array");
  const auto wide = std::count_if(array->shape.begin(), array->shape.end(), [](std::int64_t n) { return n != 1; });
  if (wide > 1) throw InputError(file, name, "has more than one dimension; one number per channel is expected");
  return finite_numbers(arrays, name, file);
}

}  // namespace

StructureLatent read_structure_latent(const std::filesystem::path& path) {
  constexpr std::size_t kMost = std::size_t{1} << 26;
  const io::NamedArrays arrays =
      read_arrays(path, {{"mean", {-1, -1, -1, -1}, kMost}, {"mean_skl", {-1, -1, -1, -1}, kMost}});
  StructureLatent latent{grid(arrays, "mean", path.string()), grid(arrays, "mean_skl", path.string())};
  if (latent.mean.shape[1] != latent.mean_skl.shape[1]) {
    throw InputError(path.string(), "mean_skl",
                     "has edge " + std::to_string(latent.mean_skl.shape[1]) + ", 'mean' has " +
                         std::to_string(latent.mean.shape[1]));
  }
  return latent;
}

void ChannelStatistics::check(const std::string& file, const std::string& place) const {
  if (mean.empty() || mean.size() != deviation.size()) {
    throw InputError(
        file, place,
        std::to_string(mean.size()) + " means and " + std::to_string(deviation.size()) + " standard deviations");
  }
  for (std::size_t c = 0; c < mean.size(); ++c) {
    if (!std::isfinite(mean[c]) || !std::isfinite(deviation[c]) || !(deviation[c] > 0.0f)) {
      throw InputError(file, place,
                       "channel " + std::to_string(c) + ": mean " + std::to_string(mean[c]) + ", standard deviation " +
                           std::to_string(deviation[c]) + "; it must be positive");
    }
  }
}

void ChannelStatistics::normalize_planes(std::vector<float>& values, std::size_t channel_count,
                                         const std::string& what) const {
  if (empty()) return;
  if (mean.size() != channel_count) {
    throw InputError(
        what, "",
        std::to_string(channel_count) + " channels, but the normalization has " + std::to_string(mean.size()));
  }
  const std::size_t count = values.size() / channel_count;
  for (std::size_t i = 0; i < values.size(); ++i) values[i] = (values[i] - mean[i / count]) / deviation[i / count];
}

void ChannelStatistics::normalize_rows(std::vector<float>& values, std::size_t channel_count,
                                       const std::string& what) const {
  if (empty()) return;
  if (mean.size() != channel_count) {
    throw InputError(
        what, "",
        std::to_string(channel_count) + " channels, but the normalization has " + std::to_string(mean.size()));
  }
  for (std::size_t i = 0; i < values.size(); ++i) {
    values[i] = (values[i] - mean[i % channel_count]) / deviation[i % channel_count];
  }
}

ChannelStatistics read_channel_statistics(const std::filesystem::path& path, const std::string& mean,
                                          const std::string& deviation, float lowest) {
  const std::string file = path.string();
  const io::NamedArrays arrays = io::read_npz(path, {mean, deviation});
  ChannelStatistics statistics{channels(arrays, mean, file), channels(arrays, deviation, file)};
  for (float& value : statistics.deviation) value = std::max(value, lowest);
  statistics.check(file, mean);
  return statistics;
}

}  // namespace anigen::loaders
