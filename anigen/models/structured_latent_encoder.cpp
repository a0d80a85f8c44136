#include "anigen/models/structured_latent_encoder.h"

#include <string>

#include "anigen/core/error.h"
#include "anigen/models/structured_latent_init.h"
#include "anigen/nn/layer_norm.h"
#include "anigen/nn/shape_text.h"

namespace anigen::models {
namespace {

using sparse::SparseTensor;
using torch::Tensor;

constexpr double kHeadNormEps = 1e-5;

StreamCoder::Parts encoder_parts(const StructuredLatentEncoderOptions& options) {
  StreamCoder::Parts parts;
  parts.torso = StructuredLatentTorso::names();
  parts.always = {"skin_encoder.joint_embedder.blocks"};
  parts.use_fp16 = options.use_fp16;
  parts.to_freeze = options.modules_to_freeze;
  parts.all_is_a_word = true;
  return parts;
}

struct EncodedRigs {
  SkeletonBatch skeletons;
  Tensor joint_features;                // [ΣJ, F]
  std::vector<Tensor> vertex_features;  // per asset [V, F]
};

EncodedRigs encode_rigs(SkinEncoder& encoder, const RiggedMeshes& rigs, torch::Device device) {
  EncodedRigs encoded;
  encoded.skeletons = SkeletonBatch::from_lists(rigs.joints, rigs.parents).to(device);
  for (std::size_t i = 0; i < rigs.skin.size(); ++i) {
    if (torch::isfinite(rigs.skin[i]).all().item<bool>()) continue;
    throw InputError("", "skin of asset " + std::to_string(i), "a weight is not finite");
  }
  const Tensor embeddings = encoder->embed_joints(encoded.skeletons);
  encoded.joint_features = encoder->joint_features(embeddings);
  const Tensor features = encoder->vertex_features(embeddings, encoded.skeletons.items, rigs.skin);
  std::vector<std::int64_t> vertices;
  for (const Tensor& weights : rigs.skin) vertices.push_back(weights.size(0));
  encoded.vertex_features = nn::Ragged(vertices).split(features);
  return encoded;
}

}  // namespace

StructuredLatentEncoderImpl::StructuredLatentEncoderImpl(const StructuredLatentEncoderOptions& options, nn::Init init)
    : StreamCoder(encoder_parts(options)), options_(options) {
  options.validate();
  const std::int64_t factor = options.latent_denoising ? 1 : 2;
  // In the order of published state dicts.
  torso_ = StructuredLatentTorso(*this, options,
                                 {options.in_channels, options.model_channels_skin, options.model_channels_skl});
  skin_encoder_ = register_module("skin_encoder", SkinEncoder(options.skin_encoder_config));
  inputs_ = StructuredLatentInputs(*this, options);
  out_.geometry = register_module("out_layer", nn::Linear(options.model_channels, 2 * options.latent_channels));
  out_.skeleton =
      register_module("out_layer_skl", nn::Linear(options.model_channels_skl, factor * options.latent_channels_skl));
  out_.skin = register_module("out_layer_vertskin",
                              nn::Linear(options.model_channels_skin, factor * options.latent_channels_vertskin));
  if (init == nn::Init::kPublished) {
    initialize_sparse_layers(*this);
    skin_encoder_->initialize();
    inputs_.initialize();
    nn::zero_parameters(*out_.geometry);
  }
  if (options.freezes()) apply_freezing();
}

StructuredLatentEncoderImpl::Latent StructuredLatentEncoderImpl::latent_of(nn::Linear& head, const Tensor& h,
                                                                           bool deterministic, const Tensor& noise) {
  const Tensor raw = head->forward(nn::layer_norm(h.to(nn::dtype_of(head->weight)), kHeadNormEps));
  if (deterministic) {
    const Tensor z = options_.normalizes() ? options_.normalize_scale * nn::unit_length(raw) : raw;
    return {z, z.detach(), torch::zeros_like(z)};
  }
  const std::vector<Tensor> halves = raw.chunk(2, 1);
  const Tensor &mean = halves[0], &logvar = halves[1];
  if (!noise.defined()) return {mean, mean, logvar};
  if (noise.sizes() != mean.sizes()) {
    throw InputError("", "noise", nn::shape_text(noise) + " does not fit latents " + nn::shape_text(mean));
  }
  return {mean + torch::exp(0.5 * logvar) * noise.to(mean.options()), mean, logvar};
}

std::vector<VertexMix> StructuredLatentEncoderImpl::skin_lookups(const sparse::Support& voxels,
                                                                 const RiggedMeshes& rigs) const {
  return skin_mixes(voxels, rigs, options_.resolution, options_.encode_upsampled_skin_feat);
}

StructuredLatentEncoderImpl::Output StructuredLatentEncoderImpl::forward(const SparseTensor& x,
                                                                         const SparseTensor& x_skl,
                                                                         const RiggedMeshes& rigs,
                                                                         const std::vector<Tensor>& noise) {
  if (x.support == nullptr) throw InputError("", "x", "has no voxels");
  return forward(x, x_skl, rigs, skin_lookups(*x.support, rigs), noise);
}

StructuredLatentEncoderImpl::Output StructuredLatentEncoderImpl::forward(const SparseTensor& x,
                                                                         const SparseTensor& x_skl,
                                                                         const RiggedMeshes& rigs,
                                                                         const std::vector<VertexMix>& lookups,
                                                                         const std::vector<Tensor>& noise) {
  check_voxel_features(x, options_.in_channels, options_.resolution, "x");
  if (x_skl.support == nullptr) throw InputError("", "x_skl", "has no voxels");
  check_voxels(*x_skl.support, options_.resolution, "x_skl");
  const std::size_t drawn = options_.latent_denoising ? 1 : 3;
  if (!noise.empty() && noise.size() != drawn) {
    throw InputError("", "noise",
                     "expected " + std::to_string(drawn) + " tensors, found " + std::to_string(noise.size()));
  }
  const auto noise_at = [&](std::size_t i) { return i < noise.size() ? noise[i] : Tensor(); };

  EncodedRigs encoded = encode_rigs(skin_encoder_, rigs, out_.geometry->weight.device());
  Output output;
  output.x_skin = inputs_.skin(*x.support, lookups, encoded.vertex_features);
  StructuredLatentInputs::Skeleton skeleton =
      inputs_.skeleton(*x_skl.support, encoded.skeletons, encoded.joint_features);
  output.x_skl = skeleton.features;
  output.joints_pos = skeleton.joints_pos;
  output.joint_skin_embeds = encoded.skeletons.items.split(encoded.joint_features);
  output.vert_skin_embeds = encoded.vertex_features;

  const PerStream<SparseTensor> h = torso_.forward({x, x.with(output.x_skin), x_skl.with(output.x_skl)});
  const bool deterministic = options_.latent_denoising;
  const Latent geometry = latent_of(out_.geometry, h.geometry.feats, false, noise_at(0));
  const Latent skin = latent_of(out_.skin, h.skin.feats, deterministic, noise_at(1));
  const Latent skl = latent_of(out_.skeleton, h.skeleton.feats, deterministic, noise_at(2));
  output.z_geometry = geometry.z;
  output.z_skin = skin.z;
  output.z = x.with(torch::cat({geometry.z, skin.z}, 1));
  output.mean = torch::cat({geometry.mean, skin.mean}, 1);
  output.logvar = torch::cat({geometry.logvar, skin.logvar}, 1);
  output.z_skl = x_skl.with(skl.z);
  output.mean_skl = skl.mean;
  output.logvar_skl = skl.logvar;
  return output;
}

StructuredLatentEncoderImpl::SkinFeatures StructuredLatentEncoderImpl::encode_skin(const RiggedMeshes& rigs) {
  EncodedRigs encoded = encode_rigs(skin_encoder_, rigs, out_.geometry->weight.device());
  return {encoded.skeletons.items.split(encoded.joint_features), encoded.vertex_features};
}

}  // namespace anigen::models
