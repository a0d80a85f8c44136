#include "anigen/models/structured_latent_encoder_inputs.h"

#include <string>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/fields/tensor_points.h"
#include "anigen/geometry/joint_field.h"
#include "anigen/nn/shape_text.h"

namespace anigen::models {
namespace {

using torch::Tensor;

constexpr std::int64_t kVoxelParts = 8;

// Centres of the eight parts of voxels, from theirs: [N, 3] → [8 N, 3].
Tensor part_centers(const Tensor& centers, std::int64_t resolution) {
  Tensor offsets = torch::empty({kVoxelParts, 3});
  const float step = 0.25F / static_cast<float>(resolution);
  for (std::int64_t part = 0; part < kVoxelParts; ++part) {
    for (std::int64_t axis = 0; axis < 3; ++axis) {
      offsets.data_ptr<float>()[3 * part + axis] = (part >> (2 - axis)) % 2 == 1 ? step : -step;
    }
  }
  return (centers.unsqueeze(1) + offsets.unsqueeze(0)).reshape({-1, 3});
}

void require_one_per_asset(std::size_t found, std::int64_t assets, const char* what) {
  if (static_cast<std::int64_t>(found) == assets) return;
  throw InputError("", what, std::to_string(found) + " for " + std::to_string(assets) + " assets");
}

VertexMix mix_of(const RiggedMeshes& rigs, std::size_t asset, const Tensor& points) {
  if (rigs.surfaces.empty()) return nearest_vertex_mix(rigs.vertices[asset], points);
  if (rigs.surfaces[asset] == nullptr) throw InputError("", "surfaces", "one is missing");
  return nearest_surface_mix(*rigs.surfaces[asset], rigs.vertices[asset], rigs.faces[asset], points);
}

struct NearestJointRows {
  Tensor joint;       // [M] int64, rows of the batch
  Tensor confidence;  // [M, 1] fp32
};

NearestJointRows nearest_joint_rows(const Tensor& centers, const nn::Ragged& voxels, const SkeletonBatch& skeletons) {
  NearestJointRows rows{torch::empty({voxels.rows()}, torch::kInt64), torch::empty({voxels.rows(), 1})};
  auto* joint = rows.joint.data_ptr<std::int64_t>();
  auto* confidence = rows.confidence.data_ptr<float>();
  const std::vector<Tensor> points = voxels.split(centers), joints = skeletons.items.split(skeletons.joints);
  for (std::size_t i = 0; i < points.size(); ++i) {
    const std::int64_t offset = skeletons.items.offset(static_cast<std::int64_t>(i));
    for (const geometry::NearestJoints& nearest : geometry::nearest_joints(
             fields::points_of<double>(points[i], "voxels"), fields::points_of<double>(joints[i], "joints"))) {
      *joint++ = offset + nearest.joint;
      *confidence++ = static_cast<float>(geometry::joint_confidence(nearest));
    }
  }
  return rows;
}

}  // namespace

std::vector<VertexMix> skin_mixes(const sparse::Support& voxels, const RiggedMeshes& rigs, std::int64_t resolution,
                                  bool upsampled) {
  const std::int64_t assets = voxels.items().items();
  require_one_per_asset(rigs.vertices.size(), assets, "vertices");
  if (!rigs.surfaces.empty()) {
    require_one_per_asset(rigs.surfaces.size(), assets, "surfaces");
    require_one_per_asset(rigs.faces.size(), assets, "faces");
  }
  const std::vector<Tensor> centers = voxels.items().split(voxels.centers(resolution));
  std::vector<VertexMix> mixes;
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

Tensor StructuredLatentInputs::skin(const sparse::Support& voxels, const std::vector<VertexMix>& mixes,
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
    rows.push_back(mixed(vertex_features[i], mixes[i]).view({lengths[i], parts * vertex_features[i].size(1)}));
  }
  return in_layer_skin_->forward(rows.size() == 1 ? rows[0] : torch::cat(rows, 0));
}

StructuredLatentInputs::Skeleton StructuredLatentInputs::skeleton(const sparse::Support& voxels,
                                                                  const SkeletonBatch& skeletons,
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

}  // namespace anigen::models
