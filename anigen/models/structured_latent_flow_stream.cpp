#include "anigen/models/structured_latent_flow_stream.h"

#include "anigen/models/recompute.h"
#include "anigen/nn/absolute_position.h"
#include "anigen/nn/layer_norm.h"
#include "anigen/nn/module_list.h"
#include "anigen/sparse/resampling.h"

namespace anigen::models {
namespace {

using sparse::SparseTensor;
using torch::Tensor;

constexpr double kSlatFlowFinalNormEps = 1e-5;

Tensor with_voxel_positions(const SparseTensor& x) {
  const Tensor places = x.support->coords().slice(1, 1).to(x.feats.device());
  return x.feats + nn::absolute_position_embedding(places, x.channels()).to(nn::dtype_of(x.feats));
}

}  // namespace

void StructuredLatentFlowStream::register_time(torch::nn::Module& model, const StructuredLatentFlowOptions& options) {
  use_skips = options.use_skip_connection;
  recompute = options.use_checkpoint;
  t_embedder = model.register_module("t_embedder" + suffix, nn::TimestepEmbedder(sizes.model_channels));
}

void StructuredLatentFlowStream::register_modulation(torch::nn::Module& model) {
  shared_modulation = model.register_module("adaLN_modulation" + suffix, nn::Modulation(sizes.model_channels));
}

void StructuredLatentFlowStream::register_joint_count(torch::nn::Module& model,
                                                      const StructuredLatentFlowOptions& options) {
  joint_embedder = model.register_module(
      "joint_num_embedder" + suffix,
      JointCountEmbedder(sizes.model_channels, options.joint_num_max, options.joint_num_fourier_bands));
  joint_unconditional = model.register_parameter("joint_num_uncond" + suffix, torch::empty({sizes.model_channels}));
}

void StructuredLatentFlowStream::register_layers(torch::nn::Module& model, const StructuredLatentFlowOptions& options,
                                                 std::int64_t context_channels) {
  const std::int64_t outer = sizes.levels() > 0 ? sizes.io_block_channels->front() : sizes.model_channels;
  input_layer = model.register_module("input_layer" + suffix, nn::Linear(sizes.in_channels, outer));
  make_residual_blocks();
  model.register_module("input_blocks" + suffix, nn::module_list(input_blocks));

  sparse::SparseModulatedBlockOptions block;
  block.channels = sizes.model_channels;
  block.context_channels = context_channels;
  block.num_heads = sizes.heads();
  block.mlp_ratio = options.mlp_ratio;
  block.qk_rms_norm = options.qk_rms_norm;
  block.qk_rms_norm_cross = options.qk_rms_norm_cross;
  block.share_mod = options.share_mod;
  block.context_norm = true;
  for (std::int64_t i = 0; i < options.num_blocks; ++i) blocks.emplace_back(block);
  model.register_module("blocks" + suffix, nn::module_list(blocks));
  model.register_module("out_blocks" + suffix, nn::module_list(out_blocks));
  out_layer = model.register_module("out_layer" + suffix, nn::Linear(outer, sizes.out_channels));
}

void StructuredLatentFlowStream::make_residual_blocks() {
  const std::int64_t width = sizes.model_channels, both = use_skips ? 2 : 1;
  std::vector<std::int64_t> widths = sizes.io_block_channels.value_or(std::vector<std::int64_t>());
  widths.push_back(width);
  for (std::size_t level = 0; level + 1 < widths.size(); ++level) {
    for (std::int64_t i = 0; i < sizes.num_io_res_blocks; ++i) {
      const std::int64_t out = i + 1 == sizes.num_io_res_blocks ? widths[level + 1] : widths[level];
      input_blocks.emplace_back(sparse::ResidualBlockOptions{widths[level], out, width});
    }
  }
  for (std::size_t level = widths.size() - 1; level-- > 0;) {
    for (std::int64_t i = 0; i < sizes.num_io_res_blocks; ++i) {
      const std::int64_t in = i == 0 ? widths[level + 1] : widths[level];
      out_blocks.emplace_back(sparse::ResidualBlockOptions{both * in, widths[level], width});
    }
  }
}

StructuredLatentFlowState StructuredLatentFlowStream::enter(const SparseTensor& x, const Tensor& t,
                                                            const Tensor& joints_num, torch::Dtype dtype) {
  StructuredLatentFlowState state;
  Tensor embedding = t_embedder->forward(t);
  if (!joint_embedder.is_empty()) embedding = embedding + joint_embedder->forward(joints_num, joint_unconditional);
  state.embedding = embedding.to(dtype);
  state.modulation = shared_modulation.is_empty() ? state.embedding : shared_modulation->forward(embedding).to(dtype);
  state.h = x.with(input_layer->forward(x.feats.to(nn::dtype_of(input_layer->weight))).to(dtype));
  descend(state);
  state.h = state.h.with(with_voxel_positions(state.h));
  return state;
}

void StructuredLatentFlowStream::descend(StructuredLatentFlowState& state) const {
  const auto per_level = static_cast<std::size_t>(sizes.num_io_res_blocks);
  for (std::size_t i = 0; i < input_blocks.size(); ++i) {
    const bool down = (i + 1) % per_level == 0;
    const sparse::SupportPtr own = state.h.support;
    const auto part = [block = input_blocks[i], own, down](const std::vector<Tensor>& inputs) mutable {
      const SparseTensor x{own, inputs[0]};
      return block->forward(down ? sparse::downsample(x, 2) : x, inputs[1]).feats;
    };
    const Tensor feats = run({state.h.feats, state.embedding}, part);
    if (down) state.finer.push_back(own);
    state.h = {down ? own->coarsened(2).support : own, feats};
    if (use_skips) state.skips.push_back(feats);
  }
}

SparseTensor StructuredLatentFlowStream::run_block(std::size_t i, const StructuredLatentFlowState& state,
                                                   const Tensor& context, const sparse::SupportPtr& places) const {
  const auto part = [block = blocks[i], own = state.h.support, places](const std::vector<Tensor>& inputs) mutable {
    const SparseTensor x{own, inputs[0]};
    if (places == nullptr) return block->forward_dense(x, inputs[1], inputs[2]).feats;
    return block->forward(x, inputs[1], {places, inputs[2]}).feats;
  };
  return state.h.with(run({state.h.feats, state.modulation, context}, part));
}

void StructuredLatentFlowStream::ascend(StructuredLatentFlowState& state) const {
  const auto per_level = static_cast<std::size_t>(sizes.num_io_res_blocks);
  for (std::size_t i = 0; i < out_blocks.size(); ++i) {
    const sparse::SupportPtr own = state.h.support;
    sparse::SupportPtr fine;  // of a block that doubles the resolution
    if (i % per_level == 0) {
      fine = state.finer.back();
      state.finer.pop_back();
    }
    std::vector<Tensor> inputs{state.embedding, state.h.feats};
    if (use_skips) {
      inputs.push_back(state.skips.back());
      state.skips.pop_back();
    }
    const auto part = [block = out_blocks[i], own, fine](const std::vector<Tensor>& rows) mutable {
      const SparseTensor x{own, rows.size() > 2 ? torch::cat({rows[1], rows[2]}, 1) : rows[1]};
      return (fine == nullptr ? block->forward(x, rows[0]) : block->forward_up(x, fine, rows[0])).feats;
    };
    state.h = {fine == nullptr ? own : fine, run(inputs, part)};
  }
}

Tensor StructuredLatentFlowStream::leave(StructuredLatentFlowState state) {
  ascend(state);
  // The norm comes before the conversion: what leaves a 16-bit torso is rounded once more.
  const Tensor rows = nn::layer_norm(state.h.feats, kSlatFlowFinalNormEps);
  return out_layer->forward(rows.to(nn::dtype_of(out_layer->weight)));
}

Tensor StructuredLatentFlowStream::run(const std::vector<Tensor>& inputs,
                                       const std::function<Tensor(const std::vector<Tensor>&)>& part) const {
  return recompute && at::GradMode::is_enabled() ? recomputed(inputs, part) : part(inputs);
}

}  // namespace anigen::models
