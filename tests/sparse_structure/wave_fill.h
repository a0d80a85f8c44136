#pragma once
#include <cmath>
#include <cstdint>
#include <string>
#include <vector>

#include "anigen/nn/state_dict.h"

namespace anigen::test {

/// Element i is scale · sin(a i + b), evaluated in double; as fp32 (docs/reference/flows.md, 7.1).
inline torch::Tensor wave(const std::vector<std::int64_t>& shape, double a, double b, double scale = 1.0,
                          double offset = 0.0) {
  torch::Tensor tensor = torch::empty(shape);
  float* values = tensor.data_ptr<float>();
  for (std::int64_t i = 0; i < tensor.numel(); ++i)
    values[i] = static_cast<float>(scale * std::sin(a * static_cast<double>(i) + b) + offset);
  return tensor;
}

/// Fills a flow model by the same rule; position tables keep their values.
inline void wave_fill(torch::nn::Module& module) {
  const torch::NoGradGuard no_grad;
  const auto ends_with = [](const std::string& key, const std::string& end) {
    return key.size() >= end.size() && key.compare(key.size() - end.size(), end.size(), end) == 0;
  };
  for (const nn::StateEntry& entry : nn::state_entries(module)) {
    if (entry.key == "pos_emb" || entry.key == "pos_emb_skl") continue;
    int codes = 0;
    for (const char letter : entry.key) codes += static_cast<unsigned char>(letter);
    const bool scale = ends_with(entry.key, "gamma") || (ends_with(entry.key, "weight") && entry.tensor.dim() == 1);
    entry.tensor.copy_(wave(entry.tensor.sizes().vec(), 0.37, 0.013 * (codes % 1000), 0.08, scale ? 1.0 : 0.0));
  }
}

}  // namespace anigen::test
