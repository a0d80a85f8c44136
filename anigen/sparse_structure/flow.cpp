#include "anigen/sparse_structure/flow.h"

#include <algorithm>
#include <utility>

#include "anigen/core/config.h"
#include "anigen/core/error.h"
#include "anigen/nn/attention_windows.h"
#include "anigen/nn/condition_cache.h"
#include "anigen/nn/linear.h"
#include "anigen/nn/norms.h"
#include "anigen/nn/volumes.h"

namespace anigen::sparse_structure {

namespace {

// Limits that no sensible model reaches, so that a mistyped size is an error and not an allocation failure.
constexpr std::int64_t kMaxFlowWidth = 16384;
constexpr std::int64_t kMaxFlowBlocks = 256;
constexpr std::int64_t kMaxFlowResolution = 128;
constexpr std::int64_t kMaxFlowTokens = 1 << 21;
constexpr std::int64_t kLoraRank = 8;

using torch::Tensor;

constexpr double kFinalNormEps = 1e-5;

std::string size_text(const std::vector<std::int64_t>& sizes) {
  std::string text = "[B";
  for (std::size_t i = 1; i < sizes.size(); ++i) text += ", " + std::to_string(sizes[i]);
  return text + "]";
}

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

nn::FreezableModel::Parts structure_flow_parts(const SparseStructureFlowOptions& options) {
  nn::FreezableModel::Parts parts;
  parts.torso = {"blocks"};  // and the exchange, which register_exchange() adds
  if (!options.geometry_only) parts.torso.push_back("blocks_skl");
  parts.use_fp16 = options.use_fp16;
  parts.to_freeze = options.modules_to_freeze;
  return parts;
}

}  // namespace

void SparseStructureFlowOptions::fields(ConfigFields& f) {
  f("resolution", resolution, {1, kMaxFlowResolution}, kRequired);
  f("in_channels", in_channels, {1, kMaxFlowWidth}, kRequired);
  f("in_channels_skl", in_channels_skl, {1, kMaxFlowWidth}, kRequired);
  f("out_channels", out_channels, {1, kMaxFlowWidth}, kRequired);
  f("out_channels_skl", out_channels_skl, {1, kMaxFlowWidth}, kRequired);
  f("model_channels", model_channels, {1, kMaxFlowWidth}, kRequired);
  f("model_channels_skl", model_channels_skl, {1, kMaxFlowWidth}, kRequired);
  f("cond_channels", cond_channels, {1, kMaxFlowWidth}, kRequired);
  f("num_blocks", num_blocks, {1, kMaxFlowBlocks}, kRequired);
  if (!f.writes() || num_heads > 0) f.or_null("num_heads", num_heads, {1, kMaxFlowWidth});
  f("num_head_channels", num_head_channels, {1, kMaxFlowWidth});
  f("mlp_ratio", mlp_ratio, {0.0, 64.0});
  f("patch_size", patch_size, {1, kMaxFlowResolution});
  f("pe_mode", pe_mode, {"ape", "rope"});
  f("use_fp16", use_fp16);
  f("use_checkpoint", use_checkpoint);
  f("share_mod", share_mod);
  f("qk_rms_norm", qk_rms_norm);
  f("qk_rms_norm_cross", qk_rms_norm_cross);
  f("use_pretrain_branch", use_pretrain_branch);
  f("freeze_pretrain_branch", freeze_pretrain_branch);
  f("use_lora_ss", use_lora_ss);
  f("lora_lr_rate_ss", lora_lr_rate_ss);
  f("modules_to_freeze", modules_to_freeze);
  f("adapter_ss_to_skl", adapter_ss_to_skl);
  f("adapter_skl_to_ss", adapter_skl_to_ss);
  f("predict_x0", predict_x0);
  f("predict_x0_skl", predict_x0_skl);
  f("t_eps", t_eps, {0.0});
  f("t_scale", t_scale, {0.0});
  f("z_is_global", z_is_global);
  f("z_skl_is_global", z_skl_is_global);
  f("global_token_num", global_token_num, {1, kMaxFlowTokens});
  f("global_token_num_skl", global_token_num_skl, {1, kMaxFlowTokens});
  f("cross_adapter_every", cross_adapter_every, {1, kMaxFlowBlocks});
  f("skl_cross_from_ss", skl_cross_from_ss);
  if (!f.writes() || geometry_only) f("geometry_only", geometry_only);
}

void SparseStructureFlowOptions::validate(const std::string& file, const std::string& pointer) const {
  if (pe_mode != "ape") throw NotSupportedError(file, pointer + "/pe_mode", "pe_mode '" + pe_mode + "'; use 'ape'");
  const OptionCheck check{file, pointer};
  check(resolution > 0 && in_channels > 0 && in_channels_skl > 0 && out_channels > 0 && out_channels_skl > 0 &&
            model_channels > 0 && model_channels_skl > 0 && cond_channels > 0 && num_blocks > 0,
        "", "every size must be positive");
  check(patch_size > 0 && resolution % patch_size == 0, "patch_size",
        "patches of " + std::to_string(patch_size) + " do not divide a resolution of " + std::to_string(resolution));
  check(heads() > 0, "num_head_channels", "leaves no head");
  const std::pair<const char*, std::int64_t> widths[] = {{"model_channels", model_channels},
                                                         {"model_channels_skl", model_channels_skl}};
  for (const auto& [key, channels] : widths) {
    check.heads(key, heads(), channels);
    check(static_cast<double>(channels) * mlp_ratio >= 1.0, "mlp_ratio", "leaves no hidden channel");
  }
  check(!predict_x0 || in_channels == out_channels, "predict_x0", "needs as many output as input channels");
  check(!predict_x0_skl || in_channels_skl == out_channels_skl, "predict_x0_skl",
        "needs as many output as input channels");
  check(t_eps > 0.0 && t_scale > 0.0, "t_eps", "t_eps and t_scale must be positive");
}

std::int64_t SparseStructureFlowOptions::tokens() const {
  const std::int64_t side = resolution / patch_size;
  return z_is_global ? global_token_num : side * side * side;
}

std::int64_t SparseStructureFlowOptions::tokens_skl() const {
  const std::int64_t side = resolution / patch_size;
  return z_skl_is_global ? global_token_num_skl : side * side * side;
}

bool SparseStructureFlowOptions::has_cross_adapter(std::int64_t block) const {
  if (!exchanges_by_attention()) return false;
  return num_blocks < cross_adapter_every ? block + 1 == num_blocks : (block + 1) % cross_adapter_every == 0;
}

std::int64_t SparseStructureFlowOptions::lora_rank_self(std::int64_t block) const {
  const std::int64_t first = std::max<std::int64_t>(1, num_blocks / 3 * 2);
  return use_lora_ss && block >= first ? kLoraRank : 0;
}

std::int64_t SparseStructureFlowOptions::lora_rank_cross(std::int64_t block) const {
  const std::int64_t third = std::max<std::int64_t>(1, num_blocks / 3);
  return use_lora_ss ? kLoraRank * (1 + block / third) : 0;
}

std::vector<std::int64_t> FlowStream::latent_size(std::int64_t batch) const {
  if (is_global) return {batch, tokens, in_channels};
  return {batch, in_channels, resolution, resolution, resolution};
}

void FlowStream::check_latent(const Tensor& x) const {
  const std::vector<std::int64_t> wanted = latent_size(x.dim() > 0 ? x.size(0) : 0);
  if (x.sizes() == torch::IntArrayRef(wanted)) return;
  throw InputError("", name, "expected shape " + size_text(wanted) + ", found " + c10::str(x.sizes()));
}

Tensor FlowStream::embed_tokens(const Tensor& x) {
  const Tensor rows = is_global ? x : nn::patchify(x, patch).flatten(2).transpose(1, 2).contiguous();
  return input_layer->forward(rows) + pos_emb;
}

Tensor FlowStream::modulation_of(const Tensor& t) {
  const Tensor embedding = t_embedder->forward(t);
  return shared_modulation.is_empty() ? embedding : shared_modulation->forward(embedding);
}

Tensor FlowStream::run_block(nn::ModulatedCrossBlock block, const Tensor& h, const Tensor& modulation,
                             const Tensor& context, std::size_t i) const {
  nn::GridWindows windows;  // of the self attention; global tokens have no places
  if (!is_global) windows = {resolution / patch, nn::AttentionWindows::size(), nn::AttentionWindows::shift(i)};
  const auto part = [block, windows](const std::vector<Tensor>& inputs) mutable {
    return block->forward(inputs[0], inputs[1], inputs[2], windows);
  };
  return nn::recomputed({h, modulation, context}, part, recompute);
}

Tensor FlowStream::receive(std::size_t i, std::int64_t crossing, const Tensor& own, const Tensor& other,
                           const Tensor& modulation) {
  if (!adapters.empty()) return own + adapters[i]->forward(other);
  if (cross_blocks.empty() || crossing < 0) return own;
  const auto c = static_cast<std::size_t>(crossing);
  const Tensor crossed = run_block(cross_blocks[c], own, modulation, other, i + 1);
  return own + cross_outputs[c]->forward(crossed - own);
}

Tensor FlowStream::project(const Tensor& h) {
  const Tensor rows = out_layer->forward(nn::layer_norm(h, kFinalNormEps));
  if (is_global) return rows;
  const std::int64_t side = resolution / patch;
  return nn::unpatchify(rows.transpose(1, 2).reshape({h.size(0), rows.size(2), side, side, side}), patch);
}

SparseStructureFlowImpl::SparseStructureFlowImpl(const SparseStructureFlowOptions& options, nn::Init init)
    : nn::FlowModel(structure_flow_parts(options)), options_(options) {
  options.validate();
  describe_streams();
  register_streams();
  torso_weight_ = shape_.blocks.front()->named_parameters()["mlp.mlp.0.weight"];
  if (init == nn::Init::kPublished) initialize_flow(*this, streams());
  if (options.freezes_shape_stream()) apply_freezing();
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

std::vector<FlowStream*> SparseStructureFlowImpl::streams() {
  if (options_.geometry_only) return {&shape_};
  return {&shape_, &skeleton_};
}

// Part by part over the streams: a checkpoint lists, and a seed draws, modules in this order.
void SparseStructureFlowImpl::register_streams() {
  FlowStream &ss = shape_, &skl = skeleton_;
  const auto key = [this](const char* part, const FlowStream* stream) {
    return std::string(part) + (stream == &skeleton_ ? "_skl" : "");
  };
  const auto input_values = [](const FlowStream* stream) {
    return stream->in_channels * stream->patch * stream->patch * stream->patch;
  };
  const auto output_values = [](const FlowStream* stream) {
    return stream->out_channels * stream->patch * stream->patch * stream->patch;
  };
  for (FlowStream* s : streams()) s->pos_emb = register_buffer(key("pos_emb", s), position_table(*s));
  for (FlowStream* s : streams())
    s->t_embedder = register_module(key("t_embedder", s), nn::TimestepEmbedder(s->channels));
  if (options_.share_mod) {
    for (FlowStream* s : streams())
      s->shared_modulation = register_module(key("adaLN_modulation", s), nn::Modulation(s->channels));
  }
  for (FlowStream* s : streams())
    s->input_layer = register_module(key("input_layer", s), nn::Linear(input_values(s), s->channels));

  const bool from_ss = options_.skl_cross_from_ss, both = !options_.geometry_only;
  ss.blocks = flow_blocks(options_, ss, options_.cond_channels, options_.use_lora_ss, false);
  if (both) skl.blocks = flow_blocks(options_, skl, from_ss ? ss.channels : options_.cond_channels, false, from_ss);
  for (FlowStream* s : streams()) register_module(key("blocks", s), nn::module_list(s->blocks));
  if (both && options_.adapter_ss_to_skl) register_exchange("ss_to_skl", ss, skl);
  if (both && options_.adapter_skl_to_ss) register_exchange("skl_to_ss", skl, ss);

  for (FlowStream* s : streams())
    s->out_layer = register_module(key("out_layer", s), nn::Linear(s->channels, output_values(s)));
}

void SparseStructureFlowImpl::register_exchange(const std::string& direction, const FlowStream& from, FlowStream& to) {
  if (!options_.exchanges_by_attention()) {
    for (std::int64_t i = 0; i < options_.num_blocks; ++i) to.adapters.emplace_back(from.channels, to.channels);
    const std::string name = "adapter_" + direction + "_layers";
    register_module(name, nn::module_list(to.adapters));
    parts_.torso.push_back(name);
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
  parts_.torso.insert(parts_.torso.end(), {name, name + "_out"});
}

void SparseStructureFlowImpl::check_inputs(const Tensor& x, const Tensor& x_skl, const Tensor& t,
                                           const Tensor& cond) const {
  shape_.check_latent(x);
  skeleton_.check_latent(x_skl);
  const std::int64_t batch = x.size(0);
  if (x_skl.size(0) != batch) throw InputError("", "x_skl", "not as many items as x");
  check_conditions(t, cond, batch, options_.cond_channels);
}

Velocity SparseStructureFlowImpl::forward(const Tensor& x, const Tensor& x_skl, const Tensor& t, const Tensor& cond) {
  check_inputs(x, x_skl, t, cond);
  const torch::Dtype dtype = compute_dtype();
  const Tensor context = nn::context_of(this, cond, [&] { return cond.expand({x.size(0), -1, -1}).to(dtype); });
  if (options_.geometry_only) {
    const Tensor m = shape_.modulation_of(t).to(dtype);
    Tensor h = shape_.embed_tokens(x).to(dtype);
    for (std::size_t i = 0; i < shape_.blocks.size(); ++i) h = shape_.run_block(shape_.blocks[i], h, m, context, i);
    const Tensor found = shape_.project(h.to(nn::dtype_of(x)));
    return {options_.predict_x0 ? velocity_of_prediction(x, found, t, options_) : found, torch::zeros_like(x_skl)};
  }
  const Tensor m = shape_.modulation_of(t).to(dtype), m_skl = skeleton_.modulation_of(t).to(dtype);
  Tensor h = shape_.embed_tokens(x).to(dtype), h_skl = skeleton_.embed_tokens(x_skl).to(dtype);
  std::int64_t crossings = 0;
  for (std::size_t i = 0; i < shape_.blocks.size(); ++i) {
    const Tensor f = shape_.run_block(shape_.blocks[i], h, m, context, i);
    const Tensor f_skl =
        skeleton_.run_block(skeleton_.blocks[i], h_skl, m_skl, options_.skl_cross_from_ss ? h : context, i);
    const std::int64_t crossing = options_.has_cross_adapter(static_cast<std::int64_t>(i)) ? crossings++ : -1;
    // h ← f + B_i(f_skl), h_skl ← f_skl + A_i(f): both adapters of the duet read what the blocks gave, not what the
    // other one has already changed.
    h = shape_.receive(i, crossing, f, f_skl, m);
    h_skl = skeleton_.receive(i, crossing, f_skl, f, m_skl);
  }
  Velocity velocity = {shape_.project(h.to(nn::dtype_of(x))), skeleton_.project(h_skl.to(nn::dtype_of(x_skl)))};
  if (options_.predict_x0) velocity.shape = velocity_of_prediction(x, velocity.shape, t, options_);
  if (options_.predict_x0_skl) velocity.skeleton = velocity_of_prediction(x_skl, velocity.skeleton, t, options_);
  return velocity;
}

void initialize_flow(torch::nn::Module& model, const std::vector<FlowStream*>& streams) {
  nn::xavier_uniform_linears(model);
  nn::default_norms(model);
  for (FlowStream* stream : streams) {
    nn::initialize_modulated_stream(*stream);
    for (const nn::Linear& adapter : stream->adapters) nn::zero_parameters(*adapter.ptr());
    for (const nn::Linear& output : stream->cross_outputs) nn::zero_parameters(*output.ptr());
  }
}

void SparseStructureFlowStageOptions::fields(ConfigFields& f) {
  flow_fields(f, /*cfg_strength=*/7.5);
  f("lambda_dice", lambda_dice, {0.0});
  f("dice_time", dice_time, {0.0, 1.0});
  f("dice_from_step", dice_from_step, {0});
  f("p_given_shape", p_given_shape, {0.0, 1.0});
}

flow::Velocities structure_velocities(SparseStructureFlow model, const Tensor& condition, bool guided,
                                      bool given_shape) {
  const auto velocity_under = [model = std::move(model), given_shape](const Tensor& tokens) {
    return [model, tokens, given_shape](const flow::Streams& x, float time) mutable {
      const Tensor t = torch::full({x[0].size(0)}, time, x[0].options());
      const Velocity velocity = model->forward(x[0], x[1], t, tokens);
      return flow::Streams{given_shape ? torch::zeros_like(x[0]) : velocity.shape, velocity.skeleton};
    };
  };
  flow::Velocities velocities;
  velocities.conditional = velocity_under(condition);
  if (guided) velocities.unconditional = velocity_under(torch::zeros_like(condition));
  return velocities;
}

}  // namespace anigen::sparse_structure
