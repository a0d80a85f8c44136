#pragma once
#include "anigen/nn/torch.h"

namespace anigen::nn {

/// [B, C, X, Y, Z] → [B, C p³, X/p, Y/p, Z/p]; channel ((c p + i) p + j) p + k holds offset (i, j, k) of the patch
/// (reference flows-and-pipeline.md, 1.3).
Tensor patchify(const Tensor& volume, std::int64_t patch);
Tensor unpatchify(const Tensor& patches, std::int64_t patch);  ///< inverse of patchify

/// [B, C s³, X, Y, Z] → [B, C, sX, sY, sZ] in the same channel order (reference autoencoders.md, 2.1, Up). Keeps the
/// memory format, contiguous or ChannelsLast3d.
Tensor pixel_shuffle_3d(const Tensor& volume, std::int64_t scale);

}  // namespace anigen::nn
