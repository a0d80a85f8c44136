#pragma once
#include <torch/torch.h>

#include <cstdint>
#include <string>
#include <vector>

#include "anigen/loaders/files/voxel_files.h"

namespace anigen::loaders {

/// Voxels of several assets, one asset after the other: what the sparse models take (reference training-and-data.md,
/// 1.4, collation).
struct RaggedVoxels {
  torch::Tensor coords;               ///< [ΣN, 4] int32: asset in the batch, x, y, z
  torch::Tensor feats;                ///< [ΣN, C] fp32; C = 0 where only places count
  std::vector<std::int64_t> lengths;  ///< N of each asset
};

/// @param rows one per asset @param ids of the assets, for messages
/// @throws InputError naming the asset whose number of channels differs from the first one's
RaggedVoxels collate_voxels(const std::vector<const VoxelRows*>& rows, const std::vector<std::string>& ids);

/// A tensor of its own from as many numbers as the shape holds. Filled by the calling thread alone: loading threads
/// must not each start a team of threads.
torch::Tensor tensor_of(const std::vector<float>& values, torch::IntArrayRef shape);

/// [B, shape…] from one list of numbers per asset. @throws InputError naming the asset whose list is longer or shorter
/// @param what of an asset, for messages
torch::Tensor stack(const std::vector<const std::vector<float>*>& values, std::vector<std::int64_t> shape,
                    const std::vector<std::string>& ids, const std::string& what);

}  // namespace anigen::loaders
