#pragma once
#include "anigen/loaders/files/latent_files.h"
#include "anigen/nn/torch.h"

namespace anigen::train {

/// Undoes the normalisation that a dataset of latents applied. @param x [B, C, …] dense, or [N, C] rows of voxels
torch::Tensor denormalised(const torch::Tensor& x, const loaders::ChannelStatistics& statistics);

}  // namespace anigen::train
