#pragma once
#include <cmath>
#include <cstdint>
#include <string>
#include <vector>

#include "anigen/io/arrays/ndarray.h"

namespace anigen::test {

// Weights of VGG16 by a formula, since the published ones are 59 MB: notes of the fixture ops_loss_lpips_vgg_formula.

/// In [-1, 1), all arithmetic modulo 2^32.
inline double lpips_hash(std::uint32_t i, std::uint32_t k) {
  std::uint32_t x = i * 0x9E3779B9u + (k + 1) * 0x85EBCA6Bu;
  x = (x ^ (x >> 16)) * 0x7feb352du;
  x = (x ^ (x >> 15)) * 0x846ca68bu;
  x ^= x >> 16;
  return x / 4294967296.0 * 2.0 - 1.0;
}

/// torchvision's number of each convolution, with its channels.
struct Vgg16Layer {
  int number;
  std::int64_t in, out;
};
inline const std::vector<Vgg16Layer>& vgg16_layers() {
  static const std::vector<Vgg16Layer> kLayers = {
      {0, 3, 64},     {2, 64, 64},    {5, 64, 128},   {7, 128, 128},  {10, 128, 256}, {12, 256, 256}, {14, 256, 256},
      {17, 256, 512}, {19, 512, 512}, {21, 512, 512}, {24, 512, 512}, {26, 512, 512}, {28, 512, 512}};
  return kLayers;
}

/// "features.N.weight", "features.N.bias".
inline io::NamedArrays formula_trunk() {
  io::NamedArrays arrays;
  for (std::size_t j = 0; j < vgg16_layers().size(); ++j) {
    const auto& [number, in, out] = vgg16_layers()[j];
    const double scale = std::sqrt(6.0 / (9.0 * static_cast<double>(in)));
    std::vector<float> weight(static_cast<std::size_t>(out * in * 9)), bias(static_cast<std::size_t>(out));
    const auto stream = static_cast<std::uint32_t>(2 * j);
    for (std::size_t i = 0; i < weight.size(); ++i)
      weight[i] = static_cast<float>(lpips_hash(static_cast<std::uint32_t>(i), stream) * scale);
    for (std::size_t i = 0; i < bias.size(); ++i)
      bias[i] = static_cast<float>(0.1 * lpips_hash(static_cast<std::uint32_t>(i), stream + 1));
    const std::string key = "features." + std::to_string(number);
    arrays.emplace_back(key + ".weight", io::NdArray::from(weight, {out, in, 3, 3}));
    arrays.emplace_back(key + ".bias", io::NdArray::from(bias, {out}));
  }
  return arrays;
}

/// "linS.model.1.weight" from one vector of channel weights per stage.
inline io::NamedArrays lpips_heads(const std::vector<std::vector<float>>& weights) {
  io::NamedArrays arrays;
  for (std::size_t s = 0; s < weights.size(); ++s) {
    arrays.emplace_back("lin" + std::to_string(s) + ".model.1.weight",
                        io::NdArray::from(weights[s], {1, static_cast<std::int64_t>(weights[s].size()), 1, 1}));
  }
  return arrays;
}

/// Heads that are not negative, as the published ones.
inline io::NamedArrays formula_heads() {
  std::vector<std::vector<float>> weights;
  for (const std::size_t channels : {64, 128, 256, 512, 512}) {
    weights.emplace_back(channels);
    for (std::size_t i = 0; i < channels; ++i) {
      weights.back()[i] = static_cast<float>(
          std::abs(lpips_hash(static_cast<std::uint32_t>(i), 100 + static_cast<std::uint32_t>(weights.size()))));
    }
  }
  return lpips_heads(weights);
}

}  // namespace anigen::test
