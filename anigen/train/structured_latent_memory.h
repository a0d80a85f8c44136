#pragma once
#include <cstdint>

#include "anigen/models/structured_latent_options.h"

namespace anigen::train {

/// About how many bytes of activations a training step of the structured-latent auto-encoder keeps for its backward
/// pass when no block is recomputed: fp32 intermediate results of blocks, up-sampling and heads. An estimate from the
/// sizes alone, the same for every run, so that whether blocks are recomputed does not depend on what the machine has
/// free.
std::int64_t activation_bytes(const models::StructuredLatentEncoderOptions& encoder,
                              const models::StructuredLatentDecoderOptions& decoder, std::int64_t voxels,
                              std::int64_t skeleton_voxels);

}  // namespace anigen::train
