#pragma once
#include "anigen/loaders/ragged_voxels.h"
#include "anigen/sparse/sparse_tensor.h"

namespace anigen::train {

/// Voxels of a batch for the sparse models: features on the device, places where they are.
/// @throws InputError for a voxel that an asset has twice
inline sparse::SparseTensor sparse_of(const loaders::RaggedVoxels& voxels, torch::Device device) {
  const auto items = static_cast<std::int64_t>(voxels.lengths.size());
  return {sparse::Support::create(voxels.coords, items), voxels.feats.to(device)};
}

}  // namespace anigen::train
