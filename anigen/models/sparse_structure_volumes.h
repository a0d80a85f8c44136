#pragma once
#include <string>
#include <vector>

#include "anigen/models/sparse_structure_options.h"
#include "anigen/models/sparse_structure_tokens.h"
#include "anigen/nn/volume_layers.h"

namespace anigen::models {

// What encoder and decoder of the sparse structure share beside their layers.

/// Axis of the channels: 1 of volumes [B, C, X, Y, Z], the last of tokens [B, T, C].
std::int64_t channel_axis(const torch::Tensor& latents);

/// L2 norm 1 over the channels at each cell or token: x / max(‖x‖, 1e-12).
torch::Tensor unit_latents(const torch::Tensor& latents);

/// "layer" or "group".
nn::VolumeNormImpl::Kind norm_kind(const std::string& norm_type);

/// Sizes of a stream's token bottleneck. @param channels width of the cells @param latent width of the tokens
GlobalTokenSizes token_sizes(const SparseStructureCoderOptions& options, bool skeleton, std::int64_t channels,
                             std::int64_t latent);

}  // namespace anigen::models
