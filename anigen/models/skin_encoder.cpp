#include "anigen/models/skin_encoder.h"

#include <string>

#include "anigen/core/error.h"
#include "anigen/nn/init.h"
#include "anigen/nn/layer_norm.h"

namespace anigen::models {
namespace {

using torch::Tensor;

void check_skin(const std::vector<Tensor>& skin, const nn::Ragged& joints) {
  if (static_cast<std::int64_t>(skin.size()) != joints.items()) {
    throw InputError(
        "", "", std::to_string(skin.size()) + " skin matrices for " + std::to_string(joints.items()) + " skeletons");
  }
  for (std::size_t i = 0; i < skin.size(); ++i) {
    if (skin[i].dim() == 2 && skin[i].size(1) == joints.lengths()[i]) continue;
    throw InputError("", "skeleton " + std::to_string(i),
                     "skin weights must have shape [V, " + std::to_string(joints.lengths()[i]) + "]");
  }
}

// Weighted sums over the joints of each asset: [ΣJ, C] → [ΣV, C].
Tensor weighted(const std::vector<Tensor>& skin, const Tensor& features, const nn::Ragged& joints) {
  const std::vector<Tensor> per_asset = joints.split(features);
  std::vector<Tensor> sums;
  for (std::size_t i = 0; i < skin.size(); ++i) sums.push_back(torch::mm(skin[i].to(features.options()), per_asset[i]));
  return sums.size() == 1 ? sums[0] : torch::cat(sums, 0);
}

}  // namespace

SkinEncoderImpl::SkinEncoderImpl(const SkinEncoderOptions& options)
    : options_(options), fourier_(options.skl_pos_embed_freq) {
  const std::int64_t embed = options.jp_embed_dim, features = options.skin_feat_channels;
  root_embedding_ = register_parameter("root_embedding", torch::empty({1, embed}));
  pos_embedder_linear_ = register_module("pos_embedder_linear", nn::Linear(fourier_.width(3), embed));
  joint_embedder_ = register_module("joint_embedder",
                                    JointEmbedder(2 * embed, options.hidden_dim(), embed, options.jp_embedder_config));
  out_layer_vert_ = register_module("out_layer_vert", nn::FeedForward(embed, features));
  out_layer_joint_ = register_module("out_layer_joint", nn::FeedForward(embed, features));
}

void SkinEncoderImpl::initialize() {
  torch::nn::init::zeros_(root_embedding_);
  nn::xavier_uniform_linears(*this);
}

Tensor SkinEncoderImpl::embed_joints(const SkeletonBatch& skeletons) {
  const Tensor joints = skeletons.joints.to(root_embedding_.options());
  const Tensor positions = options_.relative_pe ? joints - joints.index_select(0, skeletons.anchor_rows) : joints;
  const Tensor own = pos_embedder_linear_->forward(fourier_(positions));
  const Tensor parent = torch::cat({own, root_embedding_}, 0).index_select(0, skeletons.parent_rows);
  const Tensor embedded = joint_embedder_->forward(torch::cat({own, parent}, 1), skeletons.items);
  return options_.normalize_feat ? nn::unit_length(embedded) : embedded;
}

Tensor SkinEncoderImpl::joint_features(const Tensor& embeddings) { return out_layer_joint_->forward(embeddings); }

Tensor SkinEncoderImpl::vertex_features(const Tensor& embeddings, const nn::Ragged& joints,
                                        const std::vector<Tensor>& skin) {
  check_skin(skin, joints);
  // The head is applied per joint where it may be: there are far fewer joints than points.
  if (options_.vert_feat_is_linear) return weighted(skin, out_layer_vert_->forward(embeddings), joints);
  return out_layer_vert_->forward(weighted(skin, embeddings, joints));
}

}  // namespace anigen::models
