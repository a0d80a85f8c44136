#pragma once
#include <vector>

#include "anigen/nn/torch.h"

namespace anigen::nn {

/// Layers as one module with the keys `0.*`, `1.*`, …
template <typename Layer>
torch::nn::ModuleList module_list(const std::vector<Layer>& layers) {
  torch::nn::ModuleList list;
  for (const Layer& layer : layers) list->push_back(layer);
  return list;
}

}  // namespace anigen::nn
