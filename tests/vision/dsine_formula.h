#pragma once
#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "anigen/nn/state_dict.h"
#include "anigen/vision/dsine.h"

namespace anigen::test {

inline bool dsine_key_ends(const std::string& key, const std::string& end) {
  return key.size() >= end.size() && key.compare(key.size() - end.size(), end.size(), end) == 0;
}

/// Fills DSINE, in fp64, with the numbers of docs/reference/normals.md, 9.
inline void dsine_formula_fill(vision::Dsine& network) {
  std::vector<nn::StateEntry> entries;
  for (const nn::StateEntry& entry : nn::state_entries(*network)) {
    if (!dsine_key_ends(entry.key, ".num_batches_tracked")) entries.push_back(entry);
  }
  std::sort(entries.begin(), entries.end(), [](const auto& a, const auto& b) { return a.key < b.key; });
  for (std::size_t rank = 0; rank < entries.size(); ++rank) {
    const auto& [key, tensor, is_buffer] = entries[rank];
    const torch::Tensor i = torch::arange(tensor.numel(), torch::kFloat64);
    const torch::Tensor angle = 0.7 * i + 0.001 * i * torch::fmod(i, 7) + static_cast<double>(rank);
    const torch::Tensor s = torch::sin(angle).view_as(tensor);
    if (dsine_key_ends(key, "running_var")) {
      tensor.copy_(1.0 + 0.5 * s);
    } else if (tensor.dim() == 4) {
      tensor.copy_(s * std::sqrt(2.0 / static_cast<double>(tensor.numel() / tensor.size(0))));
    } else if (dsine_key_ends(key, "weight")) {
      tensor.copy_(1.0 + 0.1 * s);
    } else {
      tensor.copy_(0.1 * s);
    }
  }
}

/// The picture of the same section, [1, 3, 90, 150] in fp64.
inline torch::Tensor dsine_formula_picture() {
  const torch::Tensor q = torch::arange(3 * 90 * 150, torch::kFloat64);
  return (0.5 + 0.5 * torch::sin(0.05 * q + 0.3 * torch::fmod(q, 11))).view({1, 3, 90, 150});
}

}  // namespace anigen::test
