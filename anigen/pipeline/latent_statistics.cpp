#include "anigen/pipeline/latent_statistics.h"

#include <algorithm>
#include <cmath>

#include "anigen/core/error.h"

namespace anigen::pipeline {

LatentMoments moments_of(const std::vector<float>& values, std::size_t channels, const std::string& name) {
  if (channels == 0 || values.empty() || values.size() % channels != 0)
    throw InputError(name, "", "its latent is empty, or has a part of a channel");
  const std::size_t count = values.size() / channels;
  LatentMoments moments;
  for (std::size_t c = 0; c < channels; ++c) {
    double sum = 0.0, squares = 0.0;
    for (std::size_t i = c * count; i < (c + 1) * count; ++i) {
      const double value = values[i];
      sum += value;
      squares += value * value;
    }
    moments.mean.push_back(sum / static_cast<double>(count));
    moments.mean_square.push_back(squares / static_cast<double>(count));
  }
  return moments;
}

Json to_json(const LatentMoments& moments) { return {{"mean", moments.mean}, {"mean_square", moments.mean_square}}; }

LatentMoments latent_moments_from_json(const Json& json) {
  return {json.at("mean").get<std::vector<double>>(), json.at("mean_square").get<std::vector<double>>()};
}

void LatentStatistics::add(const LatentMoments& moments, const std::string& name) {
  const std::size_t channels = moments.mean.size();
  if (assets_ == 0) {
    sum_.assign(channels, 0.0);
    sum_of_squares_.assign(channels, 0.0);
  }
  if (channels != sum_.size()) {
    throw InputError(
        name, "",
        "its latent has " + std::to_string(channels) + " channels, others have " + std::to_string(sum_.size()));
  }
  for (std::size_t c = 0; c < channels; ++c) {
    sum_[c] += moments.mean[c];
    sum_of_squares_[c] += moments.mean_square[c];
  }
  ++assets_;
}

std::vector<float> LatentStatistics::mean() const {
  std::vector<float> result;
  for (const double sum : sum_) result.push_back(static_cast<float>(sum / static_cast<double>(assets_)));
  return result;
}

std::vector<float> LatentStatistics::deviation() const {
  std::vector<float> result;
  for (std::size_t c = 0; c < sum_.size(); ++c) {
    const auto n = static_cast<double>(assets_);
    const double mean = sum_[c] / n, variance = sum_of_squares_[c] / n - mean * mean;
    result.push_back(static_cast<float>(std::sqrt(std::max(variance, 0.0))));
  }
  return result;
}

std::vector<std::size_t> LatentStatistics::constant_channels() const {
  // E[x²] − E[x]² of equal values is not zero but some 1e-16 E[x]².
  constexpr float kRounding = 1e-6f;
  const std::vector<float> means = mean(), deviations = deviation();
  std::vector<std::size_t> channels;
  for (std::size_t c = 0; c < means.size(); ++c) {
    if (deviations[c] <= kRounding * std::abs(means[c])) channels.push_back(c);
  }
  return channels;
}

void append_arrays(io::NamedArrays& arrays, const std::string& prefix, const LatentStatistics& statistics) {
  const std::vector<float> mean = statistics.mean(), deviation = statistics.deviation();
  const auto channels = static_cast<std::int64_t>(mean.size());
  arrays.emplace_back(prefix + "_mean", io::NdArray::from(mean, {channels}));
  arrays.emplace_back(prefix + "_std", io::NdArray::from(deviation, {channels}));
}

Json to_json(const LatentStatistics& statistics) {
  return {{"mean", statistics.mean()}, {"std", statistics.deviation()}};
}

}  // namespace anigen::pipeline
