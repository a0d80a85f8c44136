#pragma once
#include <cstdint>
#include <vector>

#include "anigen/models/flop_count.h"
#include "anigen/models/structured_latent_flow_options.h"
#include "anigen/sparse/support.h"

namespace anigen::models {

/// What a pass over voxels costs depends on them through these numbers; one entry per resolution, the finest first,
/// each half as fine as the one before.
struct VoxelCounts {
  std::vector<double> voxels;
  std::vector<double> taps;         ///< Σ over voxels of how many of the 27 places around and at it exist
  std::vector<double> item_voxels;  ///< of each item, at the coarsest resolution: the tokens that attend to each other
};

/// @param levels how often the resolution is halved
VoxelCounts count_voxels(const sparse::Support& support, std::int64_t levels);

/// Of one forward pass of a structured-latent flow, all items together.
/// @param shape, skeleton counted with the levels of their streams; as many items
/// @param condition_tokens of each item
FlopCount forward_flops(const StructuredLatentFlowOptions& options, const VoxelCounts& shape,
                        const VoxelCounts& skeleton, std::int64_t condition_tokens);

}  // namespace anigen::models
