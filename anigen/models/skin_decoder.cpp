#include "anigen/models/skin_decoder.h"

#include "anigen/nn/init.h"

namespace anigen::models {

using torch::Tensor;

SkinDecoderImpl::SkinDecoderImpl(const SkinDecoderOptions& options) : options_(options) {
  const std::int64_t features = options.skin_feat_channels, channels = options.model_channels;
  root_features_ = register_parameter("root_features", torch::empty({1, features}));
  input_layer_vertex_ = register_module("input_layer_vertex", nn::Linear(features, channels));
  input_layer_skin_ = register_module("input_layer_skin", nn::Linear(2 * features, channels));
  torch::nn::ModuleList vertex_blocks, joint_blocks;
  for (std::int64_t i = 0; i < options.num_blocks; ++i) {
    if (i < options.vert_cross_blocks_num) {
      cross_blocks_.emplace_back(channels, options.num_heads);
      vertex_blocks->push_back(cross_blocks_.back());
    } else {
      vertex_blocks_.emplace_back(channels, channels);
      vertex_blocks->push_back(vertex_blocks_.back());
    }
    joint_blocks_.emplace_back(channels, options.num_heads);
    joint_blocks->push_back(joint_blocks_.back());
  }
  register_module("blocks_vertex", vertex_blocks);
  register_module("blocks_skin", joint_blocks);
  out_layer_vertex_ = register_module("out_layer_vertex", nn::Mlp(channels, 4 * channels, channels + 1));
  out_layer_skin_ = register_module("out_layer_skin", nn::Mlp(channels, 4 * channels, channels));
}

void SkinDecoderImpl::initialize() {
  torch::nn::init::zeros_(root_features_);
  nn::xavier_uniform_linears(*this);
}

SkinDecoderImpl::JointKeys SkinDecoderImpl::joint_keys(const Tensor& joint_features, const SkeletonBatch& skeletons) {
  const torch::Dtype dtype = nn::dtype_of(root_features_);
  const torch::Dtype block_dtype = joint_blocks_.empty() ? dtype : joint_blocks_.front()->dtype();
  const Tensor parents = torch::cat({joint_features, root_features_}, 0).index_select(0, skeletons.parent_rows);
  Tensor j = input_layer_skin_->forward(torch::cat({joint_features, parents}, 1)).to(block_dtype);
  JointKeys joints;
  joints.items = skeletons.items;
  for (std::size_t i = 0; i < joint_blocks_.size(); ++i) {
    // Vertices see the joints as they were before this round.
    if (i < cross_blocks_.size()) joints.rounds.push_back(j);
    j = joint_blocks_[i]->forward(j, skeletons.items);
  }
  joints.keys = skeletons.items.split(out_layer_skin_->forward(j.to(dtype)));
  return joints;
}

std::vector<Tensor> SkinDecoderImpl::logits(const Tensor& vertex_features, const nn::Ragged& vertices,
                                            const JointKeys& joints) {
  const torch::Dtype dtype = nn::dtype_of(root_features_);
  const torch::Dtype block_dtype = joint_blocks_.empty() ? dtype : joint_blocks_.front()->dtype();
  Tensor v = input_layer_vertex_->forward(vertex_features).to(block_dtype);
  for (std::size_t i = 0; i < joint_blocks_.size(); ++i) {
    v = i < cross_blocks_.size() ? cross_blocks_[i]->forward(v, vertices, joints.rounds[i], joints.items)
                                 : vertex_blocks_[i - cross_blocks_.size()]->forward(v);
  }
  const std::int64_t channels = options_.model_channels;
  const std::vector<Tensor> parts = out_layer_vertex_->forward(v.to(dtype)).split_with_sizes({channels, 1}, 1);
  const std::vector<Tensor> queries = vertices.split(parts[0]);
  const std::vector<Tensor> temperatures = vertices.split(torch::elu(parts[1]) + 2.0);  // inverse, above 1
  std::vector<Tensor> logits;
  for (std::size_t i = 0; i < joints.keys.size(); ++i) {
    logits.push_back(torch::mm(queries[i], joints.keys[i].t()) * temperatures[i]);
  }
  return logits;
}

std::vector<Tensor> SkinDecoderImpl::logits(const Tensor& vertex_features, const nn::Ragged& vertices,
                                            const Tensor& joint_features, const SkeletonBatch& skeletons) {
  return logits(vertex_features, vertices, joint_keys(joint_features, skeletons));
}

std::vector<Tensor> SkinDecoderImpl::decode(const Tensor& vertex_features, const nn::Ragged& vertices,
                                            const Tensor& joint_features, const SkeletonBatch& skeletons) {
  std::vector<Tensor> weights = logits(vertex_features, vertices, joint_features, skeletons);
  for (Tensor& item : weights) item = torch::softmax(item, -1);
  return weights;
}

std::vector<Tensor> SkinDecoderImpl::decode_log(const Tensor& vertex_features, const nn::Ragged& vertices,
                                                const Tensor& joint_features, const SkeletonBatch& skeletons) {
  std::vector<Tensor> weights = logits(vertex_features, vertices, joint_features, skeletons);
  for (Tensor& item : weights) item = torch::log_softmax(item, -1);
  return weights;
}

}  // namespace anigen::models
