#include "anigen/structured_latent/encoder.h"

#include <utility>

#include "anigen/core/error.h"
#include "anigen/nn/norms.h"
#include "anigen/skeleton_field/field.h"

namespace anigen::structured_latent {

namespace {

using torch::Tensor;

constexpr std::int64_t kVoxelParts = 8;

// Centres of the eight parts of voxels, from theirs: [N, 3] → [8 N, 3].
Tensor part_centers(const Tensor& centers, std::int64_t resolution) {
  Tensor offsets = torch::empty({kVoxelParts, 3});
  const float step = 0.25F / static_cast<float>(resolution);
  for (std::int64_t part = 0; part < kVoxelParts; ++part) {
    for (std::int64_t axis = 0; axis < 3; ++axis)
      offsets.data_ptr<float>()[3 * part + axis] = (part >> (2 - axis)) % 2 == 1 ? step : -step;
  }
  return (centers.unsqueeze(1) + offsets.unsqueeze(0)).reshape({-1, 3});
}

void require_one_per_asset(std::size_t found, std::int64_t assets, const char* what) {
  if (static_cast<std::int64_t>(found) == assets) return;
  throw InputError("", what, std::to_string(found) + " for " + std::to_string(assets) + " assets");
}

skin_field::VertexMix mix_of(const RiggedMeshes& rigs, std::size_t asset, const Tensor& points) {
  if (rigs.surfaces.empty()) return skin_field::nearest_vertex_mix(rigs.vertices[asset], points);
  if (rigs.surfaces[asset] == nullptr) throw InputError("", "surfaces", "one is missing");
  return skin_field::nearest_surface_mix(*rigs.surfaces[asset], rigs.vertices[asset], rigs.faces[asset], points);
}

struct NearestJointRows {
  Tensor joint;       // [M] int64, rows of the batch
  Tensor confidence;  // [M, 1] fp32
};

NearestJointRows nearest_joint_rows(const Tensor& centers, const nn::Ragged& voxels,
                                    const skin_field::SkeletonBatch& skeletons) {
  NearestJointRows rows{torch::empty({voxels.rows()}, torch::kInt64), torch::empty({voxels.rows(), 1})};
  auto* joint = rows.joint.data_ptr<std::int64_t>();
  auto* confidence = rows.confidence.data_ptr<float>();
  const std::vector<Tensor> points = voxels.split(centers), joints = skeletons.items.split(skeletons.joints);
  for (std::size_t i = 0; i < points.size(); ++i) {
    const std::int64_t offset = skeletons.items.offset(static_cast<std::int64_t>(i));
    for (const skeleton_field::NearestJoints& nearest : skeleton_field::nearest_joints(
             nn::points_of<double>(points[i], "voxels"), nn::points_of<double>(joints[i], "joints"))) {
      *joint++ = offset + nearest.joint;
      *confidence++ = static_cast<float>(skeleton_field::joint_confidence(nearest));
    }
  }
  return rows;
}

using sparse::SparseTensor;

constexpr double kHeadNormEps = 1e-5;

nn::FreezableModel::Parts encoder_parts(const StructuredLatentEncoderOptions& options) {
  nn::FreezableModel::Parts parts;
  parts.torso = StructuredLatentTorso::names();
  parts.always_fp16 = {"skin_encoder.joint_embedder.blocks"};
  parts.use_fp16 = options.use_fp16;
  parts.to_freeze = options.modules_to_freeze;
  parts.all_is_a_word = true;
  return parts;
}

struct EncodedRigs {
  skin_field::SkeletonBatch skeletons;
  Tensor joint_features;                // [ΣJ, F]
  std::vector<Tensor> vertex_features;  // per asset [V, F]
};

EncodedRigs encode_rigs(skin_field::SkinEncoder& encoder, const RiggedMeshes& rigs, torch::Device device) {
  EncodedRigs encoded;
  encoded.skeletons = skin_field::SkeletonBatch::from_lists(rigs.joints, rigs.parents).to(device);
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

std::vector<skin_field::VertexMix> skin_mixes(const sparse::Support& voxels, const RiggedMeshes& rigs,
                                              std::int64_t resolution, bool upsampled) {
  const std::int64_t assets = voxels.items().items();
  require_one_per_asset(rigs.vertices.size(), assets, "vertices");
  if (!rigs.surfaces.empty()) {
    require_one_per_asset(rigs.surfaces.size(), assets, "surfaces");
    require_one_per_asset(rigs.faces.size(), assets, "faces");
  }
  const std::vector<Tensor> centers = voxels.items().split(voxels.centers(resolution));
  std::vector<skin_field::VertexMix> mixes;
  for (std::size_t i = 0; i < centers.size(); ++i) {
    try {
      mixes.push_back(mix_of(rigs, i, upsampled ? part_centers(centers[i], resolution) : centers[i]));
    } catch (const InputError& error) {
      throw InputError(error.file(), "asset " + std::to_string(i), error.place() + ": " + error.problem());
    }
  }
  return mixes;
}

StructuredLatentInputs::StructuredLatentInputs(torch::nn::Module& model, const StructuredLatentEncoderOptions& options)
    : resolution_(options.resolution),
      upsampled_(options.encode_upsampled_skin_feat),
      residual_(options.jp_residual_fields),
      continuous_(options.jp_hyper_continuous),
      fourier_(options.skl_pos_embed_freq) {
  const std::int64_t features = options.skin_encoder_config.skin_feat_channels;
  const std::int64_t width = fourier_.width(continuous_ ? 4 : 3), quarter = options.model_channels_skl / 4;
  root_embedding_ = model.register_parameter("root_embedding", torch::empty({1, width}));
  in_layer_skin_ = model.register_module(
      "in_layer_skin", nn::FeedForward((upsampled_ ? kVoxelParts : 1) * features, options.model_channels_skin));
  in_layer_joints_ = model.register_module("in_layer_jp_skl", nn::FeedForward(2 * width, quarter));
  in_layer_joint_skin_ =
      model.register_module("in_layer_skin_skl", nn::FeedForward(features, options.model_channels_skl - quarter));
}

void StructuredLatentInputs::initialize() { torch::nn::init::zeros_(root_embedding_); }

Tensor StructuredLatentInputs::skin(const sparse::Support& voxels, const std::vector<skin_field::VertexMix>& mixes,
                                    const std::vector<Tensor>& vertex_features) {
  const std::vector<std::int64_t>& lengths = voxels.items().lengths();
  require_one_per_asset(mixes.size(), voxels.items().items(), "skin lookups");
  require_one_per_asset(vertex_features.size(), voxels.items().items(), "vertex features");
  const std::int64_t parts = upsampled_ ? kVoxelParts : 1;
  std::vector<Tensor> rows;
  for (std::size_t i = 0; i < mixes.size(); ++i) {
    if (mixes[i].points() != parts * lengths[i]) {
      throw InputError("", "asset " + std::to_string(i),
                       std::to_string(mixes[i].points()) + " skin lookups for " + std::to_string(lengths[i]) +
                           " voxels with " + std::to_string(parts) + " each");
    }
    rows.push_back(
        skin_field::mixed(vertex_features[i], mixes[i]).view({lengths[i], parts * vertex_features[i].size(1)}));
  }
  return in_layer_skin_->forward(rows.size() == 1 ? rows[0] : torch::cat(rows, 0));
}

StructuredLatentInputs::Skeleton StructuredLatentInputs::skeleton(const sparse::Support& voxels,
                                                                  const skin_field::SkeletonBatch& skeletons,
                                                                  const Tensor& joint_features) {
  require_one_per_asset(static_cast<std::size_t>(skeletons.items.items()), voxels.items().items(), "skeletons");
  const auto options = root_embedding_.options();
  const Tensor centers = voxels.centers(resolution_);
  const NearestJointRows nearest = nearest_joint_rows(centers, voxels.items(), skeletons);
  const Tensor joint = nearest.joint.to(options.device()), confidence = nearest.confidence.to(options);
  const Tensor parent = skeletons.parent_rows.to(options.device()).index_select(0, joint);
  const Tensor is_root = (parent == skeletons.joints.size(0)).unsqueeze(1);

  const Tensor positions = skeletons.joints.to(options), own = centers.to(options);
  const auto seen = [&](const Tensor& rows) {
    Tensor place = positions.index_select(0, rows);
    if (residual_) place = place - own;
    return continuous_ ? torch::cat({place, confidence}, 1) : place;
  };
  const Tensor to_joint = seen(joint);
  // A root has no parent; whatever stands in its row gives way to the learned embedding.
  const Tensor to_parent = seen(torch::where(is_root.squeeze(1), joint, parent));
  const Tensor parent_embedding = torch::where(is_root, root_embedding_, fourier_(to_parent));
  Skeleton result;
  result.features = torch::cat({in_layer_joints_->forward(torch::cat({fourier_(to_joint), parent_embedding}, 1)),
                                in_layer_joint_skin_->forward(joint_features.index_select(0, joint))},
                               1);
  result.joints_pos = voxels.items().split(to_joint);
  return result;
}

StructuredLatentEncoderImpl::StructuredLatentEncoderImpl(const StructuredLatentEncoderOptions& options, nn::Init init)
    : nn::FreezableModel(encoder_parts(options)), options_(options) {
  options.validate();
  const std::int64_t factor = options.latent_denoising ? 1 : 2;
  // In the order of published state dicts.
  torso_ = StructuredLatentTorso(*this, options,
                                 {options.in_channels, options.model_channels_skin, options.model_channels_skl});
  skin_encoder_ = register_module("skin_encoder", skin_field::SkinEncoder(options.skin_encoder_config));
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

nn::Latent StructuredLatentEncoderImpl::latent_of(nn::Linear& head, const Tensor& h, bool deterministic,
                                                  const Tensor& noise) {
  const Tensor raw = head->forward(nn::layer_norm(h.to(nn::dtype_of(head->weight)), kHeadNormEps));
  if (!deterministic) return nn::sampled_latent(raw, 1, noise);
  return nn::deterministic_latent(options_.normalizes() ? options_.normalize_scale * nn::unit_length(raw) : raw);
}

std::vector<skin_field::VertexMix> StructuredLatentEncoderImpl::skin_lookups(const sparse::Support& voxels,
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

StructuredLatentEncoderImpl::Output StructuredLatentEncoderImpl::forward(
    const SparseTensor& x, const SparseTensor& x_skl, const RiggedMeshes& rigs,
    const std::vector<skin_field::VertexMix>& lookups, const std::vector<Tensor>& noise) {
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
  const nn::Latent geometry = latent_of(out_.geometry, h.geometry.feats, false, noise_at(0));
  const nn::Latent skin = latent_of(out_.skin, h.skin.feats, deterministic, noise_at(1));
  const nn::Latent skl = latent_of(out_.skeleton, h.skeleton.feats, deterministic, noise_at(2));
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

}  // namespace anigen::structured_latent
