#include "anigen/models/structured_latent_flow.h"

#include <utility>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/models/freezing.h"
#include "anigen/models/structured_latent_flow_init.h"
#include "anigen/models/structured_latent_torso.h"
#include "anigen/nn/init.h"
#include "anigen/nn/kept_contexts.h"
#include "anigen/nn/module_list.h"
#include "anigen/nn/shape_text.h"

namespace anigen::models {
namespace {

using sparse::SparseTensor;
using torch::Tensor;

// The network's output is formed into a velocity; the sign is the published one, opposite to that of the sparse
// structure (reference flows-and-pipeline.md, 2.5, step 8).
Tensor velocity_of_sparse_prediction(const SparseTensor& x_t, const Tensor& output, const Tensor& t,
                                     const StructuredLatentFlowOptions& options) {
  const Tensor item = x_t.support->coords().select(1, 0).to(t.device(), torch::kInt64);
  const Tensor time = (t / options.t_scale).clamp_min(options.t_eps).index_select(0, item).unsqueeze(1);
  return (output - x_t.feats) / time.to(nn::dtype_of(output));
}

}  // namespace

StructuredLatentFlowImpl::StructuredLatentFlowImpl(const StructuredLatentFlowOptions& options, nn::Init init)
    : options_(options) {
  options.validate();
  geometry_.sizes = options.geometry;
  skin_.suffix = "_vert_skin";
  skin_.sizes = options.skin;
  skeleton_.suffix = "_skl";
  skeleton_.sizes = options.skeleton;
  register_streams();
  torso_weight_ = geometry_.blocks.front()->named_parameters()["mlp.mlp.0.weight"];
  if (init == nn::Init::kPublished) initialize_flow(*this, streams(), adapters_);
  if (options.freezes_geometry()) freeze_modules(*this, options.modules_to_freeze);
}

void StructuredLatentFlowImpl::register_streams() {
  for (StructuredLatentFlowStream* stream : streams()) stream->register_time(*this, options_);
  if (options_.share_mod) {
    for (StructuredLatentFlowStream* stream : streams()) stream->register_modulation(*this);
  }
  if (options_.use_joint_num_cond) {
    for (StructuredLatentFlowStream* stream : {&skin_, &skeleton_}) {
      stream->register_joint_count(*this, options_);
      torso_modules_.push_back("joint_num_embedder" + stream->suffix);
      torso_parameters_.push_back("joint_num_uncond" + stream->suffix);
    }
  }
  geometry_.register_layers(*this, options_, options_.cond_channels);
  skin_.register_layers(*this, options_, skeleton_.sizes.model_channels);
  skeleton_.register_layers(*this, options_, skin_.sizes.model_channels);
  for (const StructuredLatentFlowStream* stream : streams()) {
    for (const char* part : {"input_blocks", "blocks", "out_blocks"}) torso_modules_.push_back(part + stream->suffix);
  }
  for (std::int64_t i = 0; i < options_.num_blocks; ++i) {
    adapters_.emplace_back(geometry_.sizes.model_channels, skin_.sizes.model_channels);
  }
  register_module("adapter_geo_to_skin", nn::module_list(adapters_));
  torso_modules_.push_back("adapter_geo_to_skin");
}

void StructuredLatentFlowImpl::check_inputs(const SparseTensor& x, const SparseTensor& x_skl, const Tensor& t,
                                            const Tensor& cond, const Tensor& joints_num) const {
  check_voxel_rows(x, options_.geometry.in_channels + options_.skin.in_channels, "x");
  check_voxel_rows(x_skl, options_.skeleton.in_channels, "x_skl");
  const std::int64_t batch = x.support->items().items();
  const auto is_per_item = [batch](const Tensor& values, std::int64_t dims) {
    return values.dim() == dims && (values.size(0) == batch || values.size(0) == 1);
  };
  if (x_skl.support->items().items() != batch) throw InputError("", "x_skl", "not as many items as x");
  if (t.dim() != 1 || t.size(0) != batch) throw InputError("", "t", "expected one time per item");
  if (!is_per_item(cond, 3) || cond.size(2) != options_.cond_channels) {
    throw InputError("", "cond",
                     "expected tokens [" + std::to_string(batch) + " or 1, K, " +
                         std::to_string(options_.cond_channels) + "], found " + nn::shape_text(cond));
  }
  if (!joints_num.defined()) return;
  if (!options_.use_joint_num_cond) {
    throw InputError("", "joints_num", "this model is not conditioned on a number of joints (use_joint_num_cond)");
  }
  if (!is_per_item(joints_num, 1)) {
    throw InputError("", "joints_num",
                     "expected one number for each of " + std::to_string(batch) + " items, or one for all, found " +
                         nn::shape_text(joints_num));
  }
}

StructuredVelocity StructuredLatentFlowImpl::forward(const SparseTensor& x, const SparseTensor& x_skl, const Tensor& t,
                                                     const Tensor& cond, const Tensor& joints_num) {
  check_inputs(x, x_skl, t, cond, joints_num);
  const torch::Dtype dtype = compute_dtype();
  const std::int64_t batch = t.size(0), geometry_channels = geometry_.sizes.in_channels;
  const Tensor context = nn::context_of(this, cond, [&] { return cond.expand({batch, -1, -1}).to(dtype); });
  const Tensor counts = joints_num.defined() ? joints_num.to(t.device()).expand({batch}) : torch::zeros_like(t);
  const SparseTensor x_geo = x.with(x.feats.narrow(1, 0, geometry_channels));
  const SparseTensor x_skin = x.with(x.feats.narrow(1, geometry_channels, skin_.sizes.in_channels));
  StructuredLatentFlowState geo = geometry_.enter(x_geo, t, counts, dtype);
  StructuredLatentFlowState skin = skin_.enter(x_skin, t, counts, dtype);
  StructuredLatentFlowState skl = skeleton_.enter(x_skl, t, counts, dtype);
  for (std::size_t i = 0; i < adapters_.size(); ++i) {
    // All three see each other as they were before this block.
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

std::vector<std::string> StructuredLatentFlowImpl::half_precision_modules() const {
  if (!options_.use_fp16) return {};
  std::vector<std::string> names = torso_modules_;
  names.insert(names.end(), torso_parameters_.begin(), torso_parameters_.end());
  return names;
}

void StructuredLatentFlowImpl::set_compute_dtype(torch::Dtype dtype) {
  if (dtype == torch::kHalf && !torso_weight_.is_cuda()) {
    throw NotSupportedError("", "", "fp16 on a CPU; use bf16, or move the model to a GPU first");
  }
  const auto modules = named_modules();
  for (const std::string& name : torso_modules_) nn::cast_linears(*modules[name], dtype);
  auto parameters = named_parameters(/*recurse=*/false);
  for (const std::string& name : torso_parameters_) {
    Tensor& parameter = parameters[name];
    parameter.set_data(parameter.data().to(dtype));
  }
}

}  // namespace anigen::models
