#include "anigen/structured_latent/torso.h"

#include <memory>
#include <tuple>

#include "anigen/core/error.h"
#include "anigen/nn/init.h"
#include "anigen/nn/trainable.h"

namespace anigen::structured_latent {

namespace {

using sparse::SparseTensor;
using torch::Tensor;

constexpr std::int64_t kPlaceBands = 6;
constexpr int kJointBlocks = 4;
constexpr double kJointTokenEps = 1e-5;

// The joints of all assets as the places of a sparse tensor: joint j of asset b at (b, j, 0, 0).
sparse::SupportPtr joint_support(const std::vector<skeleton_field::SkeletonTensors>& skeletons) {
  std::vector<Tensor> places;
  for (std::size_t item = 0; item < skeletons.size(); ++item) {
    Tensor rows = torch::zeros({skeletons[item].joints.size(0), 4}, torch::kInt32);
    rows.select(1, 0).fill_(static_cast<std::int64_t>(item));
    rows.select(1, 1).copy_(torch::arange(rows.size(0)));
    places.push_back(rows);
  }
  return sparse::Support::create(torch::cat(places, 0), static_cast<std::int64_t>(skeletons.size()));
}

constexpr std::int64_t kUnetFactor = 2;

sparse::SubdivideBlock unet_block(std::int64_t channels) {
  sparse::SubdivideBlockOptions options;
  options.channels = options.out_channels = channels;
  options.subdivide = false;
  options.skip_convolution = true;
  return sparse::SubdivideBlock(options);
}

struct TorsoStream {
  std::int64_t channels, heads;
  std::string mode;
  std::vector<std::int64_t> contexts;
};

sparse::SparseBlockOptions block_options(const StructuredLatentCoderOptions& options, const TorsoStream& stream,
                                         std::int64_t index) {
  sparse::SparseBlockOptions block;
  block.channels = stream.channels;
  block.num_heads = stream.heads;
  block.mlp_ratio = options.mlp_ratio;
  // Every other block looks through windows shifted by half.
  const std::int64_t shift = index % 2 == 1 ? options.window_size / 2 : 0;
  block.scope = sparse::AttentionScope::of(stream.mode, options.window_size, shift);
  block.cross_scope = block.scope;
  block.qk_rms_norm = options.qk_rms_norm;
  block.context_channels = stream.contexts;
  return block;
}

SparseTensor entered(nn::Linear& input, const SparseTensor& x, torch::Dtype block_dtype) {
  Tensor h = input->forward(x.feats.to(input->weight.options()));
  const Tensor places = x.support->places_on(h.device());
  h = h + nn::absolute_position_embedding(places, h.size(1)).to(nn::dtype_of(h));
  return x.with(h.to(block_dtype));
}

template <typename Block>
std::vector<Block> registered_blocks(torch::nn::Module& model, const char* name,
                                     const StructuredLatentCoderOptions& options, const TorsoStream& stream) {
  std::vector<Block> blocks;
  for (std::int64_t i = 0; i < options.num_blocks; ++i) blocks.emplace_back(block_options(options, stream, i));
  model.register_module(name, nn::module_list(blocks));
  return blocks;
}

constexpr double kFieldHeadScale = 1e-4;

template <typename Blocks>
torch::Dtype torso_type(nn::Linear& input, Blocks& blocks) {
  return blocks.empty() ? nn::dtype_of(input->weight) : blocks.front()->dtype();
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
  for (int i = 0; i < kJointBlocks; ++i) joint_blocks_.emplace_back(block);
  model.register_module("joints_self_attn", nn::module_list(joint_blocks_));
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

SparseTensor GroupedCross::joint_context(const std::vector<skeleton_field::SkeletonTensors>& skeletons,
                                         const std::vector<skeleton_field::JointSkinFeatures>& features,
                                         torch::Dtype dtype) {
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

SparseTensor GroupedCross::forward(const SparseTensor& skin,
                                   const std::vector<skeleton_field::SkeletonTensors>& skeletons,
                                   const std::vector<skeleton_field::JointSkinFeatures>& features) {
  const torch::Dtype dtype = nn::dtype_of(place_->weight);
  const Tensor centers =  // the cube is [-1, 1]³
      nn::to_device(2.0 * skin.support->centers(resolution_), place_->weight.device());
  const Tensor places = place_->forward(fourier_(centers).to(dtype));
  const SparseTensor h = skin.with(fuse_->forward(torch::cat({skin.feats.to(dtype), places}, 1)));
  const SparseTensor attended = cross_->forward(h, {joint_context(skeletons, features, dtype)});
  return attended.with(attended.feats.to(nn::dtype_of(skin.feats)));
}

SkinUnetImpl::SkinUnetImpl(std::int64_t channels, std::int64_t levels) {
  for (std::int64_t level = 0; level < levels; ++level) {
    down_blocks_.push_back(unet_block(channels));
    fuse_.emplace_back(2 * channels, channels);
    up_blocks_.push_back(unet_block(channels));
  }
  register_module("enc", nn::module_list(down_blocks_));
  middle_ = register_module("mid", unet_block(channels));
  register_module("fuse", nn::module_list(fuse_));
  register_module("dec", nn::module_list(up_blocks_));
}

SparseTensor SkinUnetImpl::forward(const SparseTensor& x) {
  std::vector<SparseTensor> skips;
  SparseTensor h = x.with(x.feats.to(middle_->dtype()));
  for (sparse::SubdivideBlock& block : down_blocks_) {
    skips.push_back(block->forward(h));
    h = sparse::downsample(skips.back(), kUnetFactor);
  }
  h = middle_->forward(h);
  for (std::size_t level = skips.size(); level-- > 0;) {
    const SparseTensor& skip = skips[level];
    const SparseTensor up = sparse::upsample(h, skip.support, kUnetFactor);
    h = up_blocks_[level]->forward(skip.with(fuse_[level]->forward(torch::cat({up.feats, skip.feats}, 1))));
  }
  return x.with(h.feats.to(nn::dtype_of(x.feats)));
}

StructuredLatentTorso::StructuredLatentTorso(torch::nn::Module& model, const StructuredLatentCoderOptions& options,
                                             const PerStream<std::int64_t>& in_channels)
    : skin_from_geometry_(options.skin_cross_from_geo),
      skeleton_from_geometry_(options.skl_cross_from_geo),
      skin_and_skeleton_(options.skin_skl_cross),
      recompute_(options.use_checkpoint) {
  TorsoStream geometry{options.model_channels, options.heads(), options.attn_mode, {}};
  TorsoStream skin{options.model_channels_skin, options.num_heads_skin, options.attn_mode_cross, {}};
  TorsoStream skeleton{options.model_channels_skl, options.num_heads_skl, options.attn_mode_cross, {}};
  // In the order in which forward() hands them over.
  if (skin_and_skeleton_) {
    skin.contexts.push_back(skeleton.channels);
    skeleton.contexts.push_back(skin.channels);
  }
  if (skin_from_geometry_) skin.contexts.push_back(geometry.channels);
  if (skeleton_from_geometry_) skeleton.contexts.push_back(geometry.channels);

  input_.geometry = model.register_module("input_layer", nn::Linear(in_channels.geometry, geometry.channels));
  input_.skeleton = model.register_module("input_layer_skl", nn::Linear(in_channels.skeleton, skeleton.channels));
  input_.skin = model.register_module("input_layer_skin", nn::Linear(in_channels.skin, skin.channels));
  blocks_ = registered_blocks<sparse::SparseTransformerBlock>(model, "blocks", options, geometry);
  skin_blocks_ = registered_blocks<sparse::SparseMultiContextBlock>(model, "blocks_skin", options, skin);
  skeleton_blocks_ = registered_blocks<sparse::SparseMultiContextBlock>(model, "blocks_skl", options, skeleton);
}

SparseTensor StructuredLatentTorso::forward_geometry(const SparseTensor& x) {
  SparseTensor h = entered(input_.geometry, x, torso_type(input_.geometry, blocks_));
  for (std::size_t i = 0; i < blocks_.size(); ++i) h = run_geometry(i, h);
  return h;
}

SparseTensor StructuredLatentTorso::run_geometry(std::size_t i, const SparseTensor& h) const {
  return run_part(recompute_, h,
                  [block = blocks_[i]](const SparseTensor& rows) mutable { return block->forward(rows); });
}

PerStream<SparseTensor> StructuredLatentTorso::forward(const PerStream<SparseTensor>& x) {
  PerStream<SparseTensor> h{entered(input_.geometry, x.geometry, torso_type(input_.geometry, blocks_)),
                            entered(input_.skin, x.skin, torso_type(input_.skin, skin_blocks_)),
                            entered(input_.skeleton, x.skeleton, torso_type(input_.skeleton, skeleton_blocks_))};
  for (std::size_t i = 0; i < blocks_.size(); ++i) {
    const PerStream<SparseTensor> before = h;
    std::vector<SparseTensor> for_skin, for_skeleton;
    if (skin_and_skeleton_) {
      for_skin.push_back(before.skeleton);
      for_skeleton.push_back(before.skin);
    }
    if (skin_from_geometry_) for_skin.push_back(before.geometry);
    if (skeleton_from_geometry_) for_skeleton.push_back(before.geometry);
    h.geometry = run_geometry(i, before.geometry);
    h.skin = run(skin_blocks_[i], before.skin, for_skin);
    h.skeleton = run(skeleton_blocks_[i], before.skeleton, for_skeleton);
  }
  return h;
}

SparseTensor StructuredLatentTorso::run(sparse::SparseMultiContextBlock block, const SparseTensor& x,
                                        const std::vector<SparseTensor>& contexts) const {
  std::vector<Tensor> inputs{x.feats};
  std::vector<sparse::SupportPtr> supports;
  for (const SparseTensor& context : contexts) {
    inputs.push_back(context.feats);
    supports.push_back(context.support);
  }
  const auto part = [block, own = x.support, supports](const std::vector<Tensor>& rows) mutable {
    std::vector<SparseTensor> others;
    for (std::size_t k = 0; k < supports.size(); ++k) others.push_back({supports[k], rows[k + 1]});
    return block->forward({own, rows[0]}, others).feats;
  };
  return x.with(nn::recomputed(inputs, part, recompute_));
}

SparseTensor run_part(bool recompute, const SparseTensor& x,
                      const std::function<SparseTensor(const SparseTensor&)>& part) {
  if (!recompute || !at::GradMode::is_enabled()) return part(x);
  // The support of the result is known when the part runs, which recomputed() does once before it returns.
  const auto support = std::make_shared<sparse::SupportPtr>();
  const auto kept = [support, own = x.support, part](const std::vector<Tensor>& rows) {
    const SparseTensor result = part({own, rows[0]});
    *support = result.support;
    return result.feats;
  };
  const Tensor feats = nn::recomputed({x.feats}, kept);
  return {*support, feats};
}

void check_voxels(const sparse::Support& support, std::int64_t resolution, const std::string& name) {
  const Tensor places = support.coords().slice(1, 1);
  if (places.numel() == 0 || places.max().item<std::int64_t>() < resolution) return;
  const auto row = std::get<0>(places.max(1)).argmax().item<std::int64_t>();
  throw InputError("", name,
                   "voxel " + std::to_string(row) + " has an index of " +
                       std::to_string(places.max().item<std::int64_t>()) + ", outside a grid of " +
                       std::to_string(resolution) + " voxels a side");
}

void check_voxel_rows(const SparseTensor& x, std::int64_t channels, const std::string& name) {
  if (x.support != nullptr && x.feats.defined() && x.feats.dim() == 2 && x.feats.size(0) == x.support->size() &&
      x.feats.size(1) == channels) {
    return;
  }
  throw InputError("", name,
                   "must have " + std::to_string(channels) + " channels for each of " +
                       std::to_string(x.support == nullptr ? 0 : x.support->size()) + " voxels, found " +
                       nn::shape_text(x.feats));
}

void check_voxel_features(const SparseTensor& x, std::int64_t channels, std::int64_t resolution,
                          const std::string& name) {
  check_voxel_rows(x, channels, name);
  check_voxels(*x.support, resolution, name);
  const Tensor finite = torch::isfinite(x.feats).all(1);
  if (finite.all().item<bool>()) return;
  const auto row = finite.logical_not().nonzero()[0][0].item<std::int64_t>();
  throw InputError("", name, "voxel " + std::to_string(row) + " has a value that is not finite");
}

void initialize_sparse_layers(torch::nn::Module& module) {
  nn::xavier_uniform_linears(module);
  nn::default_norms(module);
  sparse::default_group_norms(module);
  sparse::default_submanifold_kernels(module);
  module.apply([](torch::nn::Module& part) {
    if (auto* block = part.as<sparse::SubdivideBlockImpl>()) block->initialize();
  });
}

void initialize_field_head(nn::LinearImpl& head) {
  const torch::NoGradGuard no_grad;
  torch::nn::init::kaiming_normal_(head.weight, 0.0, torch::kFanIn, torch::kReLU);
  head.weight.mul_(kFieldHeadScale);
  torch::nn::init::zeros_(head.bias);
}

}  // namespace anigen::structured_latent
