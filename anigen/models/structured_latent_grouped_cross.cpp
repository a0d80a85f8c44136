#include "anigen/models/structured_latent_grouped_cross.h"

namespace anigen::models {
namespace {

using sparse::SparseTensor;
using torch::Tensor;

constexpr std::int64_t kPlaceBands = 6;
constexpr int kJointBlocks = 4;
constexpr double kJointTokenEps = 1e-5;

// The joints of all assets as the places of a sparse tensor: joint j of asset b at (b, j, 0, 0).
sparse::SupportPtr joint_support(const std::vector<fields::SkeletonTensors>& skeletons) {
  std::vector<Tensor> places;
  for (std::size_t item = 0; item < skeletons.size(); ++item) {
    Tensor rows = torch::zeros({skeletons[item].joints.size(0), 4}, torch::kInt32);
    rows.select(1, 0).fill_(static_cast<std::int64_t>(item));
    rows.select(1, 1).copy_(torch::arange(rows.size(0)));
    places.push_back(rows);
  }
  return sparse::Support::create(torch::cat(places, 0), static_cast<std::int64_t>(skeletons.size()));
}

}  // namespace

JointTokensImpl::JointTokensImpl(std::int64_t in_channels, std::int64_t channels) {
  linear_ = register_module("0", nn::Linear(in_channels, channels));
  norm_ = register_module("2", nn::AffineLayerNorm(channels, kJointTokenEps));
}

Tensor JointTokensImpl::forward(const Tensor& x) { return norm_->forward(torch::silu(linear_->forward(x))); }

GroupedCross::GroupedCross(torch::nn::Module& model, const StructuredLatentDecoderOptions& options)
    : resolution_(options.resolution), fourier_(kPlaceBands) {
  const std::int64_t channels = options.model_channels_skin, features = options.skin_feat_channels();
  const std::int64_t place = fourier_.width(3);
  root_parent_feat_ = model.register_parameter("root_parent_feat", torch::empty({features}));
  joint_tokens_ = model.register_module("joints_in_proj", JointTokens(2 * features + place, channels));
  sparse::SparseBlockOptions block;
  block.channels = channels;
  block.num_heads = options.num_heads_skin;
  block.mlp_ratio = options.mlp_ratio;
  block.qk_rms_norm = options.qk_rms_norm;
  block.affine_norms = true;
  torch::nn::ModuleList list;
  for (int i = 0; i < kJointBlocks; ++i) {
    joint_blocks_.emplace_back(block);
    list->push_back(joint_blocks_.back());
  }
  model.register_module("joints_self_attn", list);
  place_ = model.register_module("h_skin_coord_proj", nn::Linear(place, channels));
  fuse_ = model.register_module("h_skin_coord_fuse", nn::Linear(2 * channels, channels));
  sparse::SparseBlockOptions cross = block;
  cross.qk_rms_norm = false;
  cross.affine_norms = false;
  cross.context_channels = {channels + features};
  cross_ = model.register_module("skin_cross_groupped_net", sparse::SparseMultiContextBlock(cross));
}

void GroupedCross::initialize() {
  if (present()) torch::nn::init::zeros_(root_parent_feat_);
}

std::vector<std::string> GroupedCross::names() {
  return {"joints_in_proj", "joints_self_attn", "skin_cross_groupped_net", "h_skin_coord_proj", "h_skin_coord_fuse"};
}

SparseTensor GroupedCross::joint_context(const std::vector<fields::SkeletonTensors>& skeletons,
                                         const std::vector<fields::JointSkinFeatures>& features, torch::Dtype dtype) {
  std::vector<Tensor> inputs, own_features;
  for (std::size_t i = 0; i < skeletons.size(); ++i) {
    const Tensor own = features[i].features.to(dtype);
    const Tensor parents = skeletons[i].parents.to(own.device(), torch::kInt64);
    const Tensor of_parent = torch::where((parents >= 0).unsqueeze(1), own.index_select(0, parents.clamp_min(0)),
                                          root_parent_feat_.to(dtype).unsqueeze(0));
    const Tensor places = fourier_(skeletons[i].joints.to(own.options()));
    inputs.push_back(torch::cat({own, places, of_parent}, 1));
    own_features.push_back(own);
  }
  const sparse::SupportPtr support = joint_support(skeletons);
  SparseTensor h{support, joint_tokens_->forward(torch::cat(inputs, 0))};
  for (sparse::SparseTransformerBlock& block : joint_blocks_) h = block->forward(h);
  return {support, torch::cat({h.feats, torch::cat(own_features, 0)}, 1)};
}

SparseTensor GroupedCross::forward(const SparseTensor& skin, const std::vector<fields::SkeletonTensors>& skeletons,
                                   const std::vector<fields::JointSkinFeatures>& features) {
  const torch::Dtype dtype = nn::dtype_of(place_->weight);
  const Tensor centers =
      (2.0 * skin.support->centers(resolution_)).to(place_->weight.device());  // the cube is [-1, 1]³
  const Tensor places = place_->forward(fourier_(centers).to(dtype));
  const SparseTensor h = skin.with(fuse_->forward(torch::cat({skin.feats.to(dtype), places}, 1)));
  const SparseTensor attended = cross_->forward(h, {joint_context(skeletons, features, dtype)});
  return attended.with(attended.feats.to(nn::dtype_of(skin.feats)));
}

}  // namespace anigen::models
