#include "anigen/models/sparse_structure_volumes.h"

#include "anigen/core/error.h"
#include "anigen/nn/init.h"

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

std::vector<std::string> torso_names() { return {"blocks", "blocks_skl", "middle_block", "middle_block_skl"}; }

void cast_torsos(torch::nn::Module& model, torch::Dtype dtype) {
  const auto children = model.named_children();
  for (const std::string& name : torso_names()) nn::cast_linears(*children[name], dtype);
}

void require_gpu_for_fp16(const torch::nn::Module& model) {
  if (!model.parameters().front().is_cuda()) {
    throw NotSupportedError("", "", "fp16 on a CPU; move the model to a GPU first");
  }
}

std::string shape_words(const Tensor& tensor) {
  if (!tensor.defined()) return "nothing";
  std::string words;
  for (const std::int64_t size : tensor.sizes()) words += (words.empty() ? "" : ", ") + std::to_string(size);
  return "[" + words + "]";
}

}  // namespace anigen::models
