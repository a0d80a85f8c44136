#include "anigen/models/structured_latent_torso.h"

#include <memory>
#include <string>
#include <tuple>

#include "anigen/core/error.h"
#include "anigen/models/recompute.h"
#include "anigen/nn/absolute_position.h"
#include "anigen/nn/shape_text.h"

namespace anigen::models {
namespace {

using sparse::SparseTensor;
using torch::Tensor;

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
  const Tensor places = x.support->coords().slice(1, 1).to(h.device());
  h = h + nn::absolute_position_embedding(places, h.size(1)).to(nn::dtype_of(h));
  return x.with(h.to(block_dtype));
}

std::vector<sparse::SparseMultiContextBlock> registered_cross_blocks(torch::nn::Module& model, const char* name,
                                                                     const StructuredLatentCoderOptions& options,
                                                                     const TorsoStream& stream) {
  std::vector<sparse::SparseMultiContextBlock> blocks;
  torch::nn::ModuleList list;
  for (std::int64_t i = 0; i < options.num_blocks; ++i) {
    blocks.emplace_back(block_options(options, stream, i));
    list->push_back(blocks.back());
  }
  model.register_module(name, list);
  return blocks;
}

}  // namespace

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
  torch::nn::ModuleList list;
  for (std::int64_t i = 0; i < options.num_blocks; ++i) {
    blocks_.emplace_back(block_options(options, geometry, i));
    list->push_back(blocks_.back());
  }
  model.register_module("blocks", list);
  skin_blocks_ = registered_cross_blocks(model, "blocks_skin", options, skin);
  skeleton_blocks_ = registered_cross_blocks(model, "blocks_skl", options, skeleton);
}

PerStream<SparseTensor> StructuredLatentTorso::forward(const PerStream<SparseTensor>& x) {
  const auto dtype = [](nn::Linear& input, auto& blocks) {
    return blocks.empty() ? nn::dtype_of(input->weight) : blocks.front()->dtype();
  };
  PerStream<SparseTensor> h{entered(input_.geometry, x.geometry, dtype(input_.geometry, blocks_)),
                            entered(input_.skin, x.skin, dtype(input_.skin, skin_blocks_)),
                            entered(input_.skeleton, x.skeleton, dtype(input_.skeleton, skeleton_blocks_))};
  for (std::size_t i = 0; i < blocks_.size(); ++i) {
    const PerStream<SparseTensor> before = h;
    std::vector<SparseTensor> for_skin, for_skeleton;
    if (skin_and_skeleton_) {
      for_skin.push_back(before.skeleton);
      for_skeleton.push_back(before.skin);
    }
    if (skin_from_geometry_) for_skin.push_back(before.geometry);
    if (skeleton_from_geometry_) for_skeleton.push_back(before.geometry);
    h.geometry = run_part(recompute_, before.geometry,
                          [block = blocks_[i]](const SparseTensor& rows) mutable { return block->forward(rows); });
    h.skin = run(skin_blocks_[i], before.skin, for_skin);
    h.skeleton = run(skeleton_blocks_[i], before.skeleton, for_skeleton);
  }
  return h;
}

SparseTensor StructuredLatentTorso::run(sparse::SparseMultiContextBlock block, const SparseTensor& x,
                                        const std::vector<SparseTensor>& contexts) const {
  if (!recompute_ || !at::GradMode::is_enabled()) return block->forward(x, contexts);
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
  return x.with(recomputed(inputs, part));
}

SparseTensor run_part(bool recompute, const SparseTensor& x,
                      const std::function<SparseTensor(const SparseTensor&)>& part) {
  if (!recompute || !at::GradMode::is_enabled()) return part(x);
  // Which support the result has shows when the part runs, which recomputed() does once before it returns.
  const auto support = std::make_shared<sparse::SupportPtr>();
  const auto kept = [support, own = x.support, part](const std::vector<Tensor>& rows) {
    const SparseTensor result = part({own, rows[0]});
    *support = result.support;
    return result.feats;
  };
  const Tensor feats = recomputed({x.feats}, kept);
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

}  // namespace anigen::models
