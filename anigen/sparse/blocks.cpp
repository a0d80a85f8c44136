#include "anigen/sparse/blocks.h"

#include <ATen/Parallel.h>

#include "anigen/core/kernel_form.h"
#include "anigen/nn/init.h"

namespace anigen::sparse {

namespace {

template <typename Options>
SparseAttention block_self_attention(const Options& options) {
  return SparseAttention(SparseAttentionOptions(nn::self_attention_of(options), options.scope));
}

SparseAttention block_cross_attention(const SparseBlockOptions& options, std::int64_t context_channels) {
  return SparseAttention(SparseAttentionOptions(cross_attention_of(options, context_channels), options.cross_scope));
}

nn::FeedForward block_mlp(const SparseBlockOptions& options) {
  return nn::FeedForward(options.channels, options.channels, options.mlp_ratio);
}

SparseAttention stream_attention(const DualStreamBlockOptions& options, bool skeleton, std::int64_t context_channels,
                                 bool qk_rms_norm) {
  nn::AttentionOptions attention = cross_attention_of(options, context_channels);
  attention.channels = skeleton ? options.channels_skl : options.channels;
  attention.num_heads = skeleton ? options.num_heads_skl : options.num_heads;
  attention.qk_rms_norm = qk_rms_norm;
  return SparseAttention(SparseAttentionOptions(attention, {}));
}

constexpr std::int64_t kChildren = 8;

ANIGEN_KERNEL(void, add_to_children,
              (const float* __restrict children, const float* __restrict parents, std::int64_t rows, std::int64_t n,
               float* __restrict sums),
              (children, parents, rows, n, sums)) {
  for (std::int64_t i = 0; i < kChildren * rows; ++i, children += n, sums += n) {
    const float* const parent = parents + i / kChildren * n;
    for (std::int64_t c = 0; c < n; ++c) sums[c] = children[c] + parent[c];
  }
}

ANIGEN_KERNEL(void, sum_of_children,
              (const float* __restrict children, std::int64_t rows, std::int64_t n, float* __restrict sums),
              (children, rows, n, sums)) {
  for (std::int64_t i = 0; i < rows; ++i, sums += n) {
    for (std::int64_t c = 0; c < n; ++c) sums[c] = 0.0F;
    for (std::int64_t k = 0; k < kChildren; ++k, children += n) {
      for (std::int64_t c = 0; c < n; ++c) sums[c] += children[c];
    }
  }
}

// Calls body(first parent, count) for all of them, by all threads.
template <typename Body>
void for_parents(const Tensor& parents, const Body& body) {
  constexpr std::int64_t kGrain = 1024;
  at::parallel_for(0, parents.size(0), kGrain, [&](std::int64_t begin, std::int64_t end) { body(begin, end - begin); });
}

// Rows of children plus that of their parent, fp32 in CPU memory. @param children [8 N, C] @param parents [N, C]
class ChildrenAndParents : public torch::autograd::Function<ChildrenAndParents> {
 public:
  static Tensor forward(torch::autograd::AutogradContext*, const Tensor& children, const Tensor& parents) {
    const Tensor sums = torch::empty_like(children);
    const std::int64_t n = parents.size(1);
    for_parents(parents, [&](std::int64_t first, std::int64_t count) {
      const std::int64_t at = kChildren * first * n;
      add_to_children(children.data_ptr<float>() + at, parents.data_ptr<float>() + first * n, count, n,
                      sums.data_ptr<float>() + at);
    });
    return sums;
  }

  static torch::autograd::variable_list backward(torch::autograd::AutogradContext*,
                                                 torch::autograd::variable_list gradients) {
    TORCH_CHECK(!at::GradMode::is_enabled(), "a subdivision's skip can be differentiated once only");
    const Tensor d_children = gradients[0].contiguous();
    const std::int64_t n = d_children.size(1);
    const Tensor d_parents = torch::empty({d_children.size(0) / kChildren, n}, d_children.options());
    for_parents(d_parents, [&](std::int64_t first, std::int64_t count) {
      sum_of_children(d_children.data_ptr<float>() + kChildren * first * n, count, n,
                      d_parents.data_ptr<float>() + first * n);
    });
    return {d_children, d_parents};
  }
};

Tensor with_parents(const Tensor& children, const Tensor& parents) {
  const bool by_kernels =
      children.is_cpu() && nn::dtype_of(children) == torch::kFloat32 && nn::dtype_of(parents) == torch::kFloat32;
  if (by_kernels) return ChildrenAndParents::apply(children.contiguous(), parents.contiguous());
  const Tensor groups = children.view({parents.size(0), kChildren, children.size(1)});
  return (groups + parents.unsqueeze(1)).reshape(children.sizes());
}

}  // namespace

SparseTransformerBlockImpl::SparseTransformerBlockImpl(const SparseBlockOptions& options) {
  norm1_ = nn::BlockNorm(*this, "norm1", options.channels, options.affine_norms);
  norm2_ = nn::BlockNorm(*this, "norm2", options.channels, options.affine_norms);
  attention_ = register_module(options.attention_name, block_self_attention(options));
  mlp_ = register_module("mlp", block_mlp(options));
}

SparseTensor SparseTransformerBlockImpl::forward(const SparseTensor& x) {
  const Tensor h = x.feats + attention_->forward(x.with(norm1_(x.feats))).feats;
  return x.with(h + mlp_->forward(norm2_(h)));
}

SparseCrossBlockImpl::SparseCrossBlockImpl(const SparseBlockOptions& options) : norm_context_(options.norm_context) {
  TORCH_CHECK(options.context_channels.size() == 1, "a cross block has one context, not ",
              options.context_channels.size());
  const std::int64_t context = options.context_channels[0];
  norm1_ = nn::BlockNorm(*this, "norm1", options.channels, options.affine_norms);
  norm2_ = nn::BlockNorm(*this, "norm2", options.channels, options.affine_norms);
  norm3_ = nn::BlockNorm(*this, "norm3", options.channels, options.affine_norms);
  if (norm_context_) norm4_ = nn::BlockNorm(*this, "norm4", context, options.affine_norms);
  self_attention_ = register_module("self_attn", block_self_attention(options));
  cross_attention_ = register_module("cross_attn", block_cross_attention(options, context));
  mlp_ = register_module("mlp", block_mlp(options));
}

SparseTensor SparseCrossBlockImpl::forward(const SparseTensor& x, const SparseTensor& context) {
  const SparseTensor seen = norm_context_ ? context.with(norm4_(context.feats)) : context;
  Tensor h = x.feats + self_attention_->forward(x.with(norm1_(x.feats))).feats;
  h = h + cross_attention_->forward(x.with(norm2_(h)), seen).feats;
  return x.with(h + mlp_->forward(norm3_(h)));
}

SparseMultiContextBlockImpl::SparseMultiContextBlockImpl(const SparseBlockOptions& options) {
  const bool cross = !options.context_channels.empty();
  norm1_ = nn::BlockNorm(*this, "norm1", options.channels, options.affine_norms);
  if (cross) norm2_ = nn::BlockNorm(*this, "norm2", options.channels, /*affine=*/true);
  norm3_ = nn::BlockNorm(*this, "norm3", options.channels, options.affine_norms);
  self_attention_ = register_module("self_attn", block_self_attention(options));
  for (const std::int64_t width : options.context_channels) {
    const std::string number = std::to_string(cross_attentions_.size());
    cross_attentions_.push_back(register_module("cross_attn_" + number, block_cross_attention(options, width)));
    context_norms_.push_back(register_module("ctx_norm_" + number, nn::AffineLayerNorm(width, nn::kBlockNormEps)));
  }
  mlp_ = register_module("mlp", block_mlp(options));
}

SparseTensor SparseMultiContextBlockImpl::forward(const SparseTensor& x, const std::vector<SparseTensor>& contexts) {
  TORCH_CHECK(contexts.size() == cross_attentions_.size(), "a block for ", cross_attentions_.size(),
              " contexts was given ", contexts.size());
  Tensor h = x.feats + self_attention_->forward(x.with(norm1_(x.feats))).feats;
  if (!contexts.empty()) {
    const SparseTensor queries = x.with(norm2_(h));
    for (std::size_t i = 0; i < contexts.size(); ++i) {
      const SparseTensor context = contexts[i].with(context_norms_[i]->forward(contexts[i].feats));
      h = h + cross_attentions_[i]->forward(queries, context).feats;
    }
  }
  return x.with(h + mlp_->forward(norm3_(h)));
}

SparseModulatedBlockImpl::SparseModulatedBlockImpl(const SparseModulatedBlockOptions& options)
    : ModulatedLayers(options, block_self_attention(options), nullptr) {}

SparseTensor SparseModulatedBlockImpl::forward(const SparseTensor& x, const Tensor& mod) {
  const auto attend = [&](const Tensor& rows) { return self_attention_->forward(x.with(rows)).feats; };
  return x.with(run(x.feats, x.support->items(), mod, attend, nullptr));
}

SparseModulatedCrossBlockImpl::SparseModulatedCrossBlockImpl(const SparseModulatedBlockOptions& options)
    : ModulatedLayers(
          options, block_self_attention(options),
          SparseAttention(SparseAttentionOptions(cross_attention_of(options, options.context_channels), {}))) {}

template <typename Cross>
SparseTensor SparseModulatedCrossBlockImpl::forward_with(const SparseTensor& x, const Tensor& mod,
                                                         const AttentionScope& scope, const Cross& cross) {
  const auto attend_self = [&](const Tensor& rows) {
    const SparseTensor h = x.with(rows);
    return (scope.windowed ? self_attention_->forward_in(h, scope) : self_attention_->forward(h)).feats;
  };
  return x.with(run(x.feats, x.support->items(), mod, attend_self,
                    [&](const Tensor& rows) { return cross(x.with(rows)).feats; }));
}

SparseTensor SparseModulatedCrossBlockImpl::forward(const SparseTensor& x, const Tensor& mod,
                                                    const SparseTensor& context, const AttentionScope& scope) {
  const SparseTensor seen = context.with(normed_context(context.feats));
  return forward_with(x, mod, scope,
                      [&](const SparseTensor& queries) { return cross_attention_->forward(queries, seen); });
}

SparseTensor SparseModulatedCrossBlockImpl::forward_dense(const SparseTensor& x, const Tensor& mod,
                                                          const Tensor& context, const AttentionScope& scope) {
  const Tensor seen = normed_context(context);
  return forward_with(x, mod, scope,
                      [&](const SparseTensor& queries) { return cross_attention_->forward_dense(queries, seen); });
}

DualStreamBlockImpl::DualStreamBlockImpl(const DualStreamBlockOptions& options) {
  const std::int64_t channels = options.channels, channels_skl = options.channels_skl;
  const std::int64_t context = options.context_channels;
  const bool norm = options.qk_rms_norm, norm_cross = options.qk_rms_norm_cross;
  norm2_ = register_module("norm2", nn::AffineLayerNorm(channels, nn::kBlockNormEps));
  norm2_skl_ = register_module("norm2_skl", nn::AffineLayerNorm(channels_skl, nn::kBlockNormEps));
  attention_ = register_module("attn", stream_attention(options, false, channels_skl, norm));
  attention_skl_ = register_module("attn_skl", stream_attention(options, true, channels, norm));
  context_attention_ = register_module("context_cross_attn", stream_attention(options, false, context, norm_cross));
  context_attention_skl_ =
      register_module("context_cross_attn_skl", stream_attention(options, true, context, norm_cross));
  mlp_ = register_module("mlp", nn::FeedForward(channels, channels, options.mlp_ratio));
  mlp_skl_ = register_module("mlp_skl", nn::FeedForward(channels_skl, channels_skl, options.mlp_ratio));
  if (options.share_mod) return;
  modulation_ = register_module("adaLN_modulation", nn::Modulation(channels));
  modulation_skl_ = register_module("adaLN_modulation_skl", nn::Modulation(channels_skl));
}

DualStreamBlockImpl::Output DualStreamBlockImpl::forward(const SparseTensor& x, const SparseTensor& x_skl,
                                                         const Tensor& mod, const Tensor& mod_skl,
                                                         const Tensor& context) {
  const auto [attention, mlp] = nn::row_modulations(modulation_, mod, x.support->items(), x.feats);
  const auto [attention_skl, mlp_skl] =
      nn::row_modulations(modulation_skl_, mod_skl, x_skl.support->items(), x_skl.feats);
  const SparseTensor seen = x_skl.with(attention_skl.modulate(x_skl.feats));
  const SparseTensor mixed = attention_->forward(x.with(attention.modulate(x.feats)), seen);
  const SparseTensor mixed_skl = attention_skl_->forward(seen, mixed);  // the shape stream as it is after its attention
  Tensor h = attention.add_gated(x.feats, mixed.feats);
  Tensor h_skl = attention_skl.add_gated(x_skl.feats, mixed_skl.feats);
  h = h + context_attention_->forward_dense(x.with(norm2_->forward(h)), context).feats;
  h_skl = h_skl + context_attention_skl_->forward_dense(x_skl.with(norm2_skl_->forward(h_skl)), context).feats;
  return {x.with(mlp.add_gated(h, mlp_->forward(mlp.modulate(h)))),
          x_skl.with(mlp_skl.add_gated(h_skl, mlp_skl_->forward(mlp_skl.modulate(h_skl))))};
}

nn::Linear DualStreamBlockImpl::modulation() const {
  return modulation_.is_empty() ? nn::Linear(nullptr) : modulation_->linear;
}

nn::Linear DualStreamBlockImpl::modulation_skl() const {
  return modulation_skl_.is_empty() ? nn::Linear(nullptr) : modulation_skl_->linear;
}

ResidualBlockImpl::ResidualBlockImpl(const ResidualBlockOptions& options) {
  const std::int64_t in = options.channels, out = options.out_channels;
  norm1_ = register_module("norm1", nn::AffineLayerNorm(in, nn::kBlockNormEps));
  conv1_ = register_module("conv1", SubmanifoldConv3d(in, out));
  conv2_ = register_module("conv2", SubmanifoldConv3d(out, out));
  modulation_ = register_module("emb_layers", nn::Modulation(options.embedding_channels, 2 * out));
  if (in != out) skip_ = register_module("skip_connection", nn::Linear(in, out));
}

SparseTensor ResidualBlockImpl::forward(const SparseTensor& x, const Tensor& embedding) {
  return finish(conv1_->forward(x.with(norm1_->activated(x.feats))), skipped(x.feats), embedding);
}

SparseTensor ResidualBlockImpl::forward_up(const SparseTensor& x, const SupportPtr& fine, const Tensor& embedding) {
  const SparseTensor h = upsample(x.with(norm1_->activated(x.feats)), fine, 2);
  return finish(conv1_->forward(h), upsample(x.with(skipped(x.feats)), fine, 2).feats, embedding);
}

Tensor ResidualBlockImpl::skipped(const Tensor& rows) { return skip_.is_empty() ? rows : skip_->forward(rows); }

SparseTensor ResidualBlockImpl::finish(const SparseTensor& h, const Tensor& skip, const Tensor& embedding) {
  const std::int64_t items = h.support->items().items();
  const Tensor values = modulation_->forward(embedding);
  TORCH_CHECK(values.dim() == 2 && values.size(0) == items, "a residual block of ", items, " items was given the ",
              "embedding ", embedding.sizes());
  const std::vector<Tensor> parts = values.chunk(2, -1);
  const nn::RowModulation modulation{h.support->items(), /*shift=*/parts[1], /*scale=*/parts[0], {}};
  return h.with(conv2_->forward(h.with(torch::silu(modulation.modulate(h.feats)))).feats + skip);
}

void ResidualBlockImpl::initialize() { nn::zero_parameters(*conv2_); }

SubdivideBlockImpl::SubdivideBlockImpl(const SubdivideBlockOptions& options) : options_(options) {
  const std::int64_t in = options.channels, out = options.out_channels;
  norm1_ = SparseGroupNorm(in, options.groups);
  norm2_ = SparseGroupNorm(out, options.groups);
  conv1_ = SubmanifoldConv3d(in, out);
  conv2_ = SubmanifoldConv3d(out, out);
  // Published as sequences; their other members, activations, have no parameters.
  torch::nn::ModuleDict act_layers, out_layers;
  act_layers->update({{"0", norm1_.ptr()}});
  out_layers->update({{"0", conv1_.ptr()}, {"1", norm2_.ptr()}, {"3", conv2_.ptr()}});
  register_module("act_layers", act_layers);
  register_module("out_layers", out_layers);
  if (in != out || options.skip_convolution) skip_ = register_module("skip_connection", SubmanifoldConv3d(in, out, 1));
}

// The skip acts on each voxel alone, so it comes before the subdivision: eight children would repeat it.
SparseTensor SubdivideBlockImpl::forward(const SparseTensor& x) {
  SparseTensor h = norm1_->forward(x, /*silu=*/true);
  if (options_.subdivide) {
    const SubmanifoldKernelImpl& kernel = *conv1_->conv;
    h = {x.support->subdivided(), subdivided_convolution(*x.support, h.feats, kernel.weight, kernel.bias)};
  } else {
    h = conv1_->forward(h);
  }
  h = norm2_->forward(h, /*silu=*/true);
  h = conv2_->forward(h);
  const Tensor skip = skip_.is_empty() ? x.feats : skip_->forward(x).feats;
  if (!options_.subdivide) return h.with(h.feats + skip);
  return h.with(with_parents(h.feats, skip));
}

void SubdivideBlockImpl::initialize() { nn::zero_parameters(*conv2_); }

torch::Dtype SubdivideBlockImpl::dtype() const { return nn::dtype_of(conv1_->conv->weight); }

SparseTensor downsample(const SparseTensor& x, const GridFactor& factor) {
  const Coarsening& coarse = x.support->coarsened(factor);
  const torch::Dtype dtype = nn::dtype_of(x.feats), wide = nn::accumulation_dtype(dtype);
  const torch::Device device = x.feats.device();
  const Tensor sums = torch::zeros({coarse.support->size(), x.channels()}, x.feats.options().dtype(wide))
                          .index_add(0, coarse.row.on(device), x.feats.to(wide));
  const Tensor members = coarse.count.on(device).to(wide).unsqueeze(1);
  return {coarse.support, (sums / (members + 1)).to(dtype)};
}

SparseTensor upsample(const SparseTensor& coarse, const SupportPtr& fine, const GridFactor& factor) {
  const Coarsening& coarsening = fine->coarsened(factor);
  TORCH_CHECK(
      coarse.support == coarsening.support || torch::equal(coarse.support->coords(), coarsening.support->coords()),
      "up-sampling from ", coarse.support->size(), " voxels, which are not the ", coarsening.support->size(),
      " that the ", fine->size(), " fine ones lie in");
  return {fine, coarse.feats.index_select(0, coarsening.row.on(coarse.feats.device()))};
}

SparseTensor subdivide(const SparseTensor& x) {
  const std::int64_t rows = x.support->size();
  return {x.support->subdivided(),
          x.feats.unsqueeze(1).expand({rows, 8, x.channels()}).reshape({8 * rows, x.channels()})};
}

}  // namespace anigen::sparse
