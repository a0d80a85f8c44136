#include "anigen/geometry/voxel_pooling.h"

#include <algorithm>
#include <string>

#include "anigen/core/error.h"

namespace anigen::geometry {
namespace {

/// Rounds toward minus infinity, so that blocks are alike on both sides of 0.
std::int32_t block_of(std::int32_t index, int factor) {
  return index >= 0 ? index / factor : -((-static_cast<std::int64_t>(index) + factor - 1) / factor);
}

}  // namespace

std::vector<Voxel> pool_voxels(const std::vector<Voxel>& voxels, int factor) {
  if (factor < 1) throw InputError("", "factor", "cannot pool blocks of " + std::to_string(factor) + " voxels");
  std::vector<Voxel> pooled = voxels;
  for (Voxel& voxel : pooled) {
    for (std::int32_t& index : voxel) index = block_of(index, factor);
  }
  sort_unique(pooled);
  return pooled;
}

PooledVoxels pool_features(const std::vector<Voxel>& voxels, const std::vector<float>& features, std::size_t channels,
                           int factor) {
  if (features.size() != voxels.size() * channels) {
    throw InputError("", "features",
                     std::to_string(features.size()) + " numbers for " + std::to_string(voxels.size()) + " voxels of " +
                         std::to_string(channels) + " channels");
  }
  PooledVoxels result;
  result.voxels = pool_voxels(voxels, factor);
  result.features.resize(result.voxels.size() * channels);
  std::vector<float> count(result.voxels.size(), 1.0f);
  for (std::size_t v = 0; v < voxels.size(); ++v) {
    Voxel block = voxels[v];
    for (std::int32_t& index : block) index = block_of(index, factor);
    const auto found = std::lower_bound(result.voxels.begin(), result.voxels.end(), block);
    const auto row = static_cast<std::size_t>(found - result.voxels.begin());
    count[row] += 1.0f;
    for (std::size_t c = 0; c < channels; ++c) result.features[row * channels + c] += features[v * channels + c];
  }
  for (std::size_t row = 0; row < count.size(); ++row) {
    for (std::size_t c = 0; c < channels; ++c) result.features[row * channels + c] /= count[row];
  }
  return result;
}

}  // namespace anigen::geometry
