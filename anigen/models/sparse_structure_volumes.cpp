#include "anigen/models/sparse_structure_volumes.h"

namespace anigen::models {

using torch::Tensor;

std::int64_t channel_axis(const Tensor& latents) { return latents.dim() == 5 ? 1 : latents.dim() - 1; }

Tensor unit_latents(const Tensor& latents) {
  namespace F = torch::nn::functional;
  return F::normalize(latents, F::NormalizeFuncOptions().p(2).dim(channel_axis(latents)).eps(1e-12));
}

nn::VolumeNormImpl::Kind norm_kind(const std::string& norm_type) {
  return norm_type == "group" ? nn::VolumeNormImpl::Kind::kGroup : nn::VolumeNormImpl::Kind::kLayer;
}

GlobalTokenSizes token_sizes(const SparseStructureCoderOptions& options, bool skeleton, std::int64_t channels,
                             std::int64_t latent) {
  GlobalTokenSizes sizes;
  sizes.tokens = skeleton ? options.global_token_num_skl : options.global_token_num;
  sizes.channels = channels;
  sizes.latent = latent;
  sizes.edge = kGlobalTokenResolution / options.downsampling();
  return sizes;
}

}  // namespace anigen::models
