#pragma once
#include <torch/types.h>

namespace anigen::pipeline {

/// Descriptions of pictures in which near means alike: means of colour over 16 × 16 cells.
/// @param pictures [B, 3, S, S] @return [B, 3 · 256]
inline torch::Tensor picture_cells(const torch::Tensor& pictures) {
  constexpr std::int64_t kCells = 16;
  const torch::NoGradGuard no_grad;
  return torch::adaptive_avg_pool2d(pictures, {kCells, kCells}).flatten(1);
}

}  // namespace anigen::pipeline
