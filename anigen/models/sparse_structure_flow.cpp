#include "anigen/models/sparse_structure_flow.h"

#include "anigen/core/error.h"
#include "anigen/models/freezing.h"
#include "anigen/models/sparse_structure_flow_init.h"
#include "anigen/nn/absolute_position.h"
#include "anigen/nn/kept_contexts.h"
#include "anigen/nn/module_list.h"

namespace anigen::models {
namespace {

using torch::Tensor;

nn::ModulatedBlockOptions flow_block_options(const SparseStructureFlowOptions& options, const FlowStream& stream,
                                             std::int64_t context_channels) {
  nn::ModulatedBlockOptions block;
  block.channels = stream.channels;
  block.context_channels = context_channels;
  block.num_heads = options.heads();
  block.mlp_ratio = options.mlp_ratio;
  block.qk_rms_norm = options.qk_rms_norm;
  block.qk_rms_norm_cross = options.qk_rms_norm_cross;
  block.share_mod = options.share_mod;
  return block;
}

std::vector<nn::ModulatedCrossBlock> flow_blocks(const SparseStructureFlowOptions& options, const FlowStream& stream,
                                                 std::int64_t context_channels, bool lora, bool context_norm) {
  std::vector<nn::ModulatedCrossBlock> blocks;
  for (std::int64_t i = 0; i < options.num_blocks; ++i) {
    nn::ModulatedBlockOptions block = flow_block_options(options, stream, context_channels);
    block.context_norm = context_norm;
    if (lora) {
      block.lora_self = nn::Lora{options.lora_rank_self(i), options.lora_lr_rate_ss};
      block.lora_cross = nn::Lora{options.lora_rank_cross(i), options.lora_lr_rate_ss};
    }
    blocks.emplace_back(block);
  }
  return blocks;
}

Tensor position_table(const FlowStream& stream) {
  const Tensor cells = stream.is_global ? torch::arange(stream.tokens, torch::kInt64).unsqueeze(1)
                                        : nn::grid_coordinates(stream.resolution / stream.patch);
  return nn::absolute_position_embedding(cells, stream.channels);
}

// The network's output is x₀: v = (x_t − x₀) / max(t, ε) with t in [0, 1].
Tensor velocity_of_prediction(const Tensor& x_t, const Tensor& x_0, const Tensor& t,
                              const SparseStructureFlowOptions& options) {
  std::vector<std::int64_t> shape(static_cast<std::size_t>(x_t.dim()), 1);
  shape[0] = t.size(0);
  return (x_t - x_0) / (t / options.t_scale).clamp_min(options.t_eps).to(x_t.options()).view(shape);
}

}  // namespace

SparseStructureFlowImpl::SparseStructureFlowImpl(const SparseStructureFlowOptions& options, nn::Init init)
    : options_(options) {
  options.validate();
  describe_streams();
  register_streams();
  torso_weight_ = shape_.blocks.front()->named_parameters()["mlp.mlp.0.weight"];
  if (init == nn::Init::kPublished) initialize_flow(*this, shape_, skeleton_);
  if (options.freezes_shape_stream()) freeze_modules(*this, options.modules_to_freeze);
}

void SparseStructureFlowImpl::describe_streams() {
  shape_.name = "x";
  shape_.in_channels = options_.in_channels;
  shape_.out_channels = options_.out_channels;
  shape_.channels = options_.model_channels;
  shape_.tokens = options_.tokens();
  shape_.is_global = options_.z_is_global;
  skeleton_.name = "x_skl";
  skeleton_.in_channels = options_.in_channels_skl;
  skeleton_.out_channels = options_.out_channels_skl;
  skeleton_.channels = options_.model_channels_skl;
  skeleton_.tokens = options_.tokens_skl();
  skeleton_.is_global = options_.z_skl_is_global;
  for (FlowStream* stream : {&shape_, &skeleton_}) {
    stream->resolution = options_.resolution;
    stream->patch = stream->is_global ? 1 : options_.patch_size;
    stream->recompute = options_.use_checkpoint;
  }
}

void SparseStructureFlowImpl::register_streams() {
  FlowStream &ss = shape_, &skl = skeleton_;
  ss.pos_emb = register_buffer("pos_emb", position_table(ss));
  skl.pos_emb = register_buffer("pos_emb_skl", position_table(skl));
  ss.t_embedder = register_module("t_embedder", nn::TimestepEmbedder(ss.channels));
  skl.t_embedder = register_module("t_embedder_skl", nn::TimestepEmbedder(skl.channels));
  if (options_.share_mod) {
    ss.shared_modulation = register_module("adaLN_modulation", nn::Modulation(ss.channels));
    skl.shared_modulation = register_module("adaLN_modulation_skl", nn::Modulation(skl.channels));
  }
  const auto values_per_token = [](const FlowStream& stream) { return stream.patch * stream.patch * stream.patch; };
  ss.input_layer = register_module("input_layer", nn::Linear(ss.in_channels * values_per_token(ss), ss.channels));
  skl.input_layer =
      register_module("input_layer_skl", nn::Linear(skl.in_channels * values_per_token(skl), skl.channels));

  const bool from_ss = options_.skl_cross_from_ss;
  ss.blocks = flow_blocks(options_, ss, options_.cond_channels, options_.use_lora_ss, false);
  skl.blocks = flow_blocks(options_, skl, from_ss ? ss.channels : options_.cond_channels, false, from_ss);
  register_module("blocks", nn::module_list(ss.blocks));
  register_module("blocks_skl", nn::module_list(skl.blocks));
  if (options_.adapter_ss_to_skl) register_exchange("ss_to_skl", ss, skl);
  if (options_.adapter_skl_to_ss) register_exchange("skl_to_ss", skl, ss);

  ss.out_layer = register_module("out_layer", nn::Linear(ss.channels, ss.out_channels * values_per_token(ss)));
  skl.out_layer = register_module("out_layer_skl", nn::Linear(skl.channels, skl.out_channels * values_per_token(skl)));
}

void SparseStructureFlowImpl::register_exchange(const std::string& direction, const FlowStream& from, FlowStream& to) {
  if (!options_.exchanges_by_attention()) {
    for (std::int64_t i = 0; i < options_.num_blocks; ++i) to.adapters.emplace_back(from.channels, to.channels);
    const std::string name = "adapter_" + direction + "_layers";
    register_module(name, nn::module_list(to.adapters));
    torso_modules_.push_back(name);
    return;
  }
  for (std::int64_t i = 0; i < options_.num_blocks; ++i) {
    if (!options_.has_cross_adapter(i)) continue;
    to.cross_blocks.emplace_back(flow_block_options(options_, to, from.channels));
    to.cross_outputs.emplace_back(to.channels, to.channels);
  }
  const std::string name = "cross_blocks_" + direction;
  register_module(name, nn::module_list(to.cross_blocks));
  register_module(name + "_out", nn::module_list(to.cross_outputs));
  torso_modules_.insert(torso_modules_.end(), {name, name + "_out"});
}

void SparseStructureFlowImpl::check_inputs(const Tensor& x, const Tensor& x_skl, const Tensor& t,
                                           const Tensor& cond) const {
  shape_.check_latent(x);
  skeleton_.check_latent(x_skl);
  const std::int64_t batch = x.size(0);
  if (x_skl.size(0) != batch) throw InputError("", "x_skl", "not as many items as x");
  if (t.dim() != 1 || t.size(0) != batch) throw InputError("", "t", "expected one time per item");
  if (cond.dim() != 3 || cond.size(2) != options_.cond_channels || (cond.size(0) != batch && cond.size(0) != 1)) {
    throw InputError("", "cond",
                     "expected tokens [" + std::to_string(batch) + " or 1, M, " +
                         std::to_string(options_.cond_channels) + "], found " + c10::str(cond.sizes()));
  }
}

Velocity SparseStructureFlowImpl::forward(const Tensor& x, const Tensor& x_skl, const Tensor& t, const Tensor& cond) {
  check_inputs(x, x_skl, t, cond);
  const torch::Dtype dtype = compute_dtype();
  const Tensor context = nn::context_of(this, cond, [&] { return cond.expand({x.size(0), -1, -1}).to(dtype); });
  const Tensor m = shape_.modulation_of(t).to(dtype), m_skl = skeleton_.modulation_of(t).to(dtype);
  Tensor h = shape_.embed_tokens(x).to(dtype), h_skl = skeleton_.embed_tokens(x_skl).to(dtype);
  std::int64_t crossings = 0;
  for (std::size_t i = 0; i < shape_.blocks.size(); ++i) {
    const Tensor f = shape_.run_block(i, h, m, context);
    const Tensor f_skl = skeleton_.run_block(i, h_skl, m_skl, options_.skl_cross_from_ss ? h : context);
    const std::int64_t crossing = options_.has_cross_adapter(static_cast<std::int64_t>(i)) ? crossings++ : -1;
    // Both read what the blocks gave, not what the other exchange has already changed.
    h = shape_.receive(i, crossing, f, f_skl, m);
    h_skl = skeleton_.receive(i, crossing, f_skl, f, m_skl);
  }
  Velocity velocity = {shape_.project(h.to(nn::dtype_of(x))), skeleton_.project(h_skl.to(nn::dtype_of(x_skl)))};
  if (options_.predict_x0) velocity.shape = velocity_of_prediction(x, velocity.shape, t, options_);
  if (options_.predict_x0_skl) velocity.skeleton = velocity_of_prediction(x_skl, velocity.skeleton, t, options_);
  return velocity;
}

std::vector<std::string> SparseStructureFlowImpl::half_precision_modules() const {
  return options_.use_fp16 ? torso_modules_ : std::vector<std::string>{};
}

void SparseStructureFlowImpl::set_compute_dtype(torch::Dtype dtype) {
  if (dtype == torch::kHalf && !torso_weight_.is_cuda()) {
    throw NotSupportedError("", "", "fp16 on a CPU; use bf16, or move the model to a GPU first");
  }
  const auto modules = named_modules();
  for (const std::string& name : torso_modules_) nn::cast_linears(*modules[name], dtype);
}

}  // namespace anigen::models
