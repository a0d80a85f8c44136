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

/// The modules that compute in fp16 in the published system (reference autoencoders.md, 2.1, fp16 torso).
std::vector<std::string> torso_names();
/// Converts the parameters of their convolutions in place.
void cast_torsos(torch::nn::Module& model, torch::Dtype dtype);
/// @throws NotSupportedError when the model is not on a GPU
void require_gpu_for_fp16(const torch::nn::Module& model);

/// "[2, 8, 4, 4, 4]", for messages.
std::string shape_words(const torch::Tensor& tensor);

}  // namespace anigen::models
