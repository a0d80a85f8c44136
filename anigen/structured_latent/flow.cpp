#include "anigen/structured_latent/flow.h"

#include <utility>

#include "anigen/core/config.h"
#include "anigen/core/error.h"
#include "anigen/nn/attention_windows.h"
#include "anigen/nn/condition_cache.h"
#include "anigen/nn/linear.h"
#include "anigen/nn/norms.h"
#include "anigen/nn/torch.h"
#include "anigen/sparse/convolution.h"
#include "anigen/structured_latent/torso.h"

namespace anigen::structured_latent {

namespace {

// Limits that no sensible model reaches, so that a mistyped size is an error and not an allocation failure.
constexpr std::int64_t kMostSlatFlowChannels = 16384;
constexpr std::int64_t kMostSlatFlowBlocks = 256;
constexpr std::int64_t kMostSlatFlowResolution = 1 << 20;
constexpr std::int64_t kMostSlatFlowJoints = 1 << 16;
constexpr std::int64_t kMostSlatFlowBands = 24;
constexpr std::int64_t kMostSlatFlowLevels = 8;

using StreamSizes = StructuredLatentFlowStreamOptions;

struct SlatFlowStreamKey {
  const char* suffix;
  StreamSizes StructuredLatentFlowOptions::*stream;
};
constexpr SlatFlowStreamKey kSlatFlowStreams[] = {{"", &StructuredLatentFlowOptions::geometry},
                                                  {"_vert_skin", &StructuredLatentFlowOptions::skin},
                                                  {"_skl", &StructuredLatentFlowOptions::skeleton}};

void check_flow_stream(const OptionCheck& check, const std::string& suffix, const StreamSizes& stream,
                       const StructuredLatentFlowOptions& options) {
  check(stream.in_channels > 0 && stream.out_channels > 0 && stream.model_channels > 0, "model_channels" + suffix,
        "every width must be positive");
  check(stream.heads() > 0, "num_head_channels" + suffix, "leaves no head");
  check.heads("model_channels" + suffix, stream.heads(), stream.model_channels);
  check(static_cast<double>(stream.model_channels) * options.mlp_ratio >= 1.0, "mlp_ratio", "leaves no hidden channel");
  if (!stream.io_block_channels) return;
  const std::string key = "io_block_channels" + suffix;
  for (const std::int64_t width : *stream.io_block_channels)
    check(width > 0 && width <= kMostSlatFlowChannels, key, "widths must be positive and sensible");
  check(stream.num_io_res_blocks > 0, "num_io_res_blocks" + suffix, "must be at least 1");
  check(stream.levels() <= kMostSlatFlowLevels && options.patch_size == std::int64_t{1} << stream.levels(), key,
        std::to_string(stream.levels()) + " widths halve the resolution as often, which is not a patch_size of " +
            std::to_string(options.patch_size));
}

using sparse::SparseTensor;
using torch::Tensor;

constexpr double kSlatFlowFinalNormEps = 1e-5;

Tensor with_voxel_positions(const SparseTensor& x) {
  const Tensor places = x.support->places_on(x.feats.device());
  return x.feats + nn::absolute_position_embedding(places, x.channels()).to(nn::dtype_of(x.feats));
}

// x₀ prediction: v = (x̂ − x_t) / max(t, ε) of the network's output x̂; the sign is the published one, opposite to that
// of the sparse structure (docs/reference/flows.md, 2.1).
Tensor velocity_of_sparse_prediction(const SparseTensor& x_t, const Tensor& output, const Tensor& t,
                                     const StructuredLatentFlowOptions& options) {
  const Tensor item = x_t.support->items().item_of_rows(t.device());
  const Tensor time = (t / options.t_scale).clamp_min(options.t_eps).index_select(0, item).unsqueeze(1);
  return (output - x_t.feats) / time.to(nn::dtype_of(output));
}

// The torso is listed by register_streams().
nn::FreezableModel::Parts slat_flow_parts(const StructuredLatentFlowOptions& options) {
  nn::FreezableModel::Parts parts;
  parts.use_fp16 = options.use_fp16;
  parts.to_freeze = options.modules_to_freeze;
  return parts;
}

}  // namespace

void StructuredLatentFlowStreamOptions::fields(ConfigFields& f, const std::string& suffix) {
  f("in_channels" + suffix, in_channels, {1, kMostSlatFlowChannels}, kRequired);
  f("out_channels" + suffix, out_channels, {1, kMostSlatFlowChannels}, kRequired);
  f("model_channels" + suffix, model_channels, {1, kMostSlatFlowChannels}, kRequired);
  f.or_null("num_heads" + suffix, num_heads, {1, kMostSlatFlowChannels});
  f("num_head_channels" + suffix, num_head_channels, {1, kMostSlatFlowChannels});
  f("num_io_res_blocks" + suffix, num_io_res_blocks, {1, kMostSlatFlowBlocks});
  f("io_block_channels" + suffix, io_block_channels);
}

void StructuredLatentFlowOptions::fields(ConfigFields& f) {
  f("resolution", resolution, {1, kMostSlatFlowResolution}, kRequired);
  for (const auto& [suffix, stream] : kSlatFlowStreams) (this->*stream).fields(f, suffix);
  f("cond_channels", cond_channels, {1, kMostSlatFlowChannels}, kRequired);
  f("num_blocks", num_blocks, {1, kMostSlatFlowBlocks}, kRequired);
  f("mlp_ratio", mlp_ratio, {0.0, 64.0});
  f("patch_size", patch_size, {1, std::int64_t{1} << kMostSlatFlowLevels});
  f("pe_mode", pe_mode, {"ape", "rope"});
  f("use_fp16", use_fp16);
  f("use_checkpoint", use_checkpoint);
  f("use_skip_connection", use_skip_connection);
  f("share_mod", share_mod);
  f("qk_rms_norm", qk_rms_norm);
  f("qk_rms_norm_cross", qk_rms_norm_cross);
  f("use_pretrain_branch", use_pretrain_branch);
  f("freeze_pretrain_branch", freeze_pretrain_branch);
  f("predict_x0", predict_x0);
  f("use_joint_num_cond", use_joint_num_cond);
  if (!f.writes() || geometry_only) f("geometry_only", geometry_only);
  f("modules_to_freeze", modules_to_freeze);
  f("t_eps", t_eps, {0.0});
  f("t_scale", t_scale, {0.0});
  f("joint_num_max", joint_num_max, {1, kMostSlatFlowJoints});
  f("joint_num_fourier_bands", joint_num_fourier_bands, {1, kMostSlatFlowBands});
}

void StructuredLatentFlowOptions::validate(const std::string& file, const std::string& pointer) const {
  if (pe_mode != "ape") throw NotSupportedError(file, pointer + "/pe_mode", "pe_mode '" + pe_mode + "'; use 'ape'");
  const OptionCheck check{file, pointer};
  check(resolution > 0 && cond_channels > 0 && num_blocks > 0, "", "every size must be positive");
  for (const auto& [suffix, stream] : kSlatFlowStreams) check_flow_stream(check, suffix, this->*stream, *this);
  check(geometry.levels() == skin.levels(), "io_block_channels_vert_skin",
        "the skin must have as many widths as the geometry, whose voxels it shares");
  for (const auto& [suffix, stream] : kSlatFlowStreams) {
    const StreamSizes& sizes = this->*stream;
    const bool concerned = predict_x0 && &sizes != &geometry;
    check(!concerned || sizes.in_channels == sizes.out_channels, std::string("out_channels") + suffix,
          "predict_x0 needs as many output as input channels");
  }
  check(t_eps > 0.0 && t_scale > 0.0, "t_eps", "t_eps and t_scale must be positive");
  check(joint_num_max > 0 && joint_num_fourier_bands > 0, "joint_num_max",
        "joint_num_max and joint_num_fourier_bands must be positive");
  check(!geometry_only || !use_joint_num_cond, "geometry_only", "has no joints to be told the number of");
}

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
      nn::JointCountEmbedder(sizes.model_channels, options.joint_num_max, options.joint_num_fourier_bands));
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
    const Tensor feats = nn::recomputed({state.h.feats, state.embedding}, part, recompute);
    if (down) state.finer.push_back(own);
    state.h = {down ? own->coarsened(2).support : own, feats};
    if (use_skips) state.skips.push_back(feats);
  }
}

SparseTensor StructuredLatentFlowStream::run_block(std::size_t i, const StructuredLatentFlowState& state,
                                                   const Tensor& context, const sparse::SupportPtr& places) const {
  sparse::AttentionScope scope;  // of the self attention
  if (const std::int64_t window = nn::AttentionWindows::size(); window > 0)
    scope = {/*windowed=*/true, window, nn::AttentionWindows::shift(i)};
  const auto part = [block = blocks[i], own = state.h.support, places,
                     scope](const std::vector<Tensor>& inputs) mutable {
    const SparseTensor x{own, inputs[0]};
    if (places == nullptr) return block->forward_dense(x, inputs[1], inputs[2], scope).feats;
    return block->forward(x, inputs[1], {places, inputs[2]}, scope).feats;
  };
  return state.h.with(nn::recomputed({state.h.feats, state.modulation, context}, part, recompute));
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
    state.h = {fine == nullptr ? own : fine, nn::recomputed(inputs, part, recompute)};
  }
}

Tensor StructuredLatentFlowStream::leave(StructuredLatentFlowState state) {
  ascend(state);
  // The norm comes before the conversion: what leaves a 16-bit torso is rounded once more.
  const Tensor rows = nn::layer_norm(state.h.feats, kSlatFlowFinalNormEps);
  return out_layer->forward(rows.to(nn::dtype_of(out_layer->weight)));
}

StructuredLatentFlowImpl::StructuredLatentFlowImpl(const StructuredLatentFlowOptions& options, nn::Init init)
    : nn::FlowModel(slat_flow_parts(options)), options_(options) {
  options.validate();
  geometry_.sizes = options.geometry;
  skin_.suffix = "_vert_skin";
  skin_.sizes = options.skin;
  skeleton_.suffix = "_skl";
  skeleton_.sizes = options.skeleton;
  register_streams();
  torso_weight_ = geometry_.blocks.front()->named_parameters()["mlp.mlp.0.weight"];
  if (init == nn::Init::kPublished) initialize_flow(*this, streams(), adapters_);
  if (options.freezes_geometry()) apply_freezing();
}

std::vector<StructuredLatentFlowStream*> StructuredLatentFlowImpl::streams() {
  if (options_.geometry_only) return {&geometry_};
  return {&geometry_, &skin_, &skeleton_};
}

void StructuredLatentFlowImpl::register_streams() {
  for (StructuredLatentFlowStream* stream : streams()) stream->register_time(*this, options_);
  if (options_.share_mod) {
    for (StructuredLatentFlowStream* stream : streams()) stream->register_modulation(*this);
  }
  if (options_.use_joint_num_cond) {
    for (StructuredLatentFlowStream* stream : {&skin_, &skeleton_}) {
      stream->register_joint_count(*this, options_);
      parts_.torso.push_back("joint_num_embedder" + stream->suffix);
      parts_.torso_parameters.push_back("joint_num_uncond" + stream->suffix);
    }
  }
  geometry_.register_layers(*this, options_, options_.cond_channels);
  if (!options_.geometry_only) {
    skin_.register_layers(*this, options_, skeleton_.sizes.model_channels);
    skeleton_.register_layers(*this, options_, skin_.sizes.model_channels);
  }
  for (const StructuredLatentFlowStream* stream : streams()) {
    for (const char* part : {"input_blocks", "blocks", "out_blocks"}) parts_.torso.push_back(part + stream->suffix);
  }
  if (options_.geometry_only) return;
  for (std::int64_t i = 0; i < options_.num_blocks; ++i)
    adapters_.emplace_back(geometry_.sizes.model_channels, skin_.sizes.model_channels);
  register_module("adapter_geo_to_skin", nn::module_list(adapters_));
  parts_.torso.push_back("adapter_geo_to_skin");
}

void StructuredLatentFlowImpl::check_inputs(const SparseTensor& x, const SparseTensor& x_skl, const Tensor& t,
                                            const Tensor& cond, const Tensor& joints_num) const {
  check_voxel_rows(x, options_.geometry.in_channels + options_.skin.in_channels, "x");
  check_voxel_rows(x_skl, options_.skeleton.in_channels, "x_skl");
  const std::int64_t batch = x.support->items().items();
  if (x_skl.support->items().items() != batch) throw InputError("", "x_skl", "not as many items as x");
  check_conditions(t, cond, batch, options_.cond_channels);
  if (!joints_num.defined()) return;
  if (!options_.use_joint_num_cond)
    throw InputError("", "joints_num", "this model is not conditioned on a number of joints (use_joint_num_cond)");
  if (joints_num.dim() != 1 || (joints_num.size(0) != batch && joints_num.size(0) != 1)) {
    throw InputError("", "joints_num",
                     "expected one number for each of " + std::to_string(batch) + " items, or one for all, found " +
                         nn::shape_text(joints_num));
  }
}

Tensor StructuredLatentFlowImpl::geometry_velocity(const SparseTensor& x, const Tensor& t, const Tensor& context) {
  StructuredLatentFlowState h =
      geometry_.enter(x.with(x.feats.narrow(1, 0, geometry_.sizes.in_channels)), t, {}, compute_dtype());
  for (std::size_t i = 0; i < geometry_.blocks.size(); ++i) h.h = geometry_.run_block(i, h, context);
  return geometry_.leave(std::move(h)).to(nn::dtype_of(x.feats));
}

StructuredVelocity StructuredLatentFlowImpl::forward(const SparseTensor& x, const SparseTensor& x_skl, const Tensor& t,
                                                     const Tensor& cond, const Tensor& joints_num) {
  check_inputs(x, x_skl, t, cond, joints_num);
  const torch::Dtype dtype = compute_dtype();
  const std::int64_t batch = t.size(0), geometry_channels = geometry_.sizes.in_channels;
  const Tensor context = nn::context_of(this, cond, [&] { return cond.expand({batch, -1, -1}).to(dtype); });
  if (options_.geometry_only) {
    const Tensor none = torch::zeros({x.feats.size(0), skin_.sizes.in_channels}, x.feats.options());
    return {x.with(torch::cat({geometry_velocity(x, t, context), none}, 1)),
            x_skl.with(torch::zeros_like(x_skl.feats))};
  }
  const Tensor counts =
      joints_num.defined() ? nn::to_device(joints_num, t.device()).expand({batch}) : torch::zeros_like(t);
  const SparseTensor x_geo = x.with(x.feats.narrow(1, 0, geometry_channels));
  const SparseTensor x_skin = x.with(x.feats.narrow(1, geometry_channels, skin_.sizes.in_channels));
  StructuredLatentFlowState geo = geometry_.enter(x_geo, t, counts, dtype);
  StructuredLatentFlowState skin = skin_.enter(x_skin, t, counts, dtype);
  StructuredLatentFlowState skl = skeleton_.enter(x_skl, t, counts, dtype);
  for (std::size_t i = 0; i < adapters_.size(); ++i) {
    // f = block_i(h, e, cond), f_skin = block_i(h_skin, e_skin, h_skl) + A_i(h), f_skl = block_i(h_skl, e_skl, h_skin):
    // all three see each other as they were before this block.
    const Tensor from_geometry = adapters_[i]->forward(geo.h.feats);
    geo.h = geometry_.run_block(i, geo, context);
    const SparseTensor f_skin = skin_.run_block(i, skin, skl.h.feats, skl.h.support);
    skl.h = skeleton_.run_block(i, skl, skin.h.feats, skin.h.support);
    skin.h = f_skin.with(f_skin.feats + from_geometry);
  }
  const torch::Dtype out = nn::dtype_of(x.feats), out_skl = nn::dtype_of(x_skl.feats);
  const Tensor v_geo = geometry_.leave(std::move(geo)).to(out);
  Tensor v_skin = skin_.leave(std::move(skin)).to(out), v_skl = skeleton_.leave(std::move(skl)).to(out_skl);
  if (options_.predict_x0) {
    v_skin = velocity_of_sparse_prediction(x_skin, v_skin, t, options_);
    v_skl = velocity_of_sparse_prediction(x_skl, v_skl, t, options_);
  }
  return {x.with(torch::cat({v_geo, v_skin}, 1)), x_skl.with(v_skl)};
}

void initialize_flow(torch::nn::Module& model, const std::vector<StructuredLatentFlowStream*>& streams,
                     const std::vector<nn::Linear>& adapters) {
  nn::xavier_uniform_linears(model);
  nn::default_norms(model);
  sparse::default_submanifold_kernels(model);
  for (StructuredLatentFlowStream* stream : streams) {
    nn::initialize_modulated_stream(*stream);
    if (stream->joint_unconditional.defined()) torch::nn::init::zeros_(stream->joint_unconditional);
    for (auto* blocks : {&stream->input_blocks, &stream->out_blocks}) {
      for (sparse::ResidualBlock& block : *blocks) block->initialize();
    }
  }
  for (const nn::Linear& adapter : adapters) nn::zero_parameters(*adapter.ptr());
}

}  // namespace anigen::structured_latent
