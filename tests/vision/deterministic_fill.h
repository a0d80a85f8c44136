#pragma once
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <string>
#include <vector>

#include "anigen/nn/state_dict.h"

namespace anigen::test {

/// The deterministic numbers of docs/reference/autoencoders.md, appendix B: U(k, n) in [-1, 1).
inline double golden_value(std::uint64_t k, std::uint64_t n) {
  std::uint64_t s = (k << 32) + n + 0x9E3779B97F4A7C15ULL;
  s = (s ^ (s >> 30)) * 0xBF58476D1CE4E5B9ULL;
  s = (s ^ (s >> 27)) * 0x94D049BB133111EBULL;
  s ^= s >> 31;
  return static_cast<double>(s >> 40) / 8388608.0 - 1.0;
}

/// scale · T(k) of a shape, as fp32.
inline torch::Tensor golden_tensor(std::uint64_t k, const std::vector<std::int64_t>& shape, double scale = 1.0,
                                   double offset = 0.0) {
  torch::Tensor tensor = torch::empty(shape);
  float* values = tensor.data_ptr<float>();
  for (std::int64_t n = 0; n < tensor.numel(); ++n)
    values[n] = static_cast<float>(scale * golden_value(k, static_cast<std::uint64_t>(n)) + offset);
  return tensor;
}

/// Fills the parameters of a model by the same rule: the k-th key in byte order gets numbers of stream k.
inline void golden_fill(torch::nn::Module& module) {
  std::vector<nn::StateEntry> entries = nn::state_entries(module);
  std::sort(entries.begin(), entries.end(), [](const auto& a, const auto& b) { return a.key < b.key; });
  const torch::NoGradGuard no_grad;
  for (std::size_t k = 0; k < entries.size(); ++k) {
    const std::string suffix = ".weight", &key = entries[k].key;
    const bool weight =
        key.size() > suffix.size() && key.compare(key.size() - suffix.size(), suffix.size(), suffix) == 0;
    const torch::Tensor& tensor = entries[k].tensor;
    double scale = 0.1, offset = 0.0;
    if (tensor.dim() >= 2) {
      scale = std::sqrt(3.0 / static_cast<double>(tensor.numel() / tensor.size(0)));
    } else if (weight) {
      offset = 1.0;
    }
    entries[k].tensor.copy_(golden_tensor(k, tensor.sizes().vec(), scale, offset));
  }
}

}  // namespace anigen::test
