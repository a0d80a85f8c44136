#include "anigen/nn/blocks.h"

#include <vector>

#include "anigen/nn/kernels/rows.h"

namespace anigen::nn {

FeedForwardImpl::FeedForwardImpl(std::int64_t in_channels, std::int64_t out_channels, double mlp_ratio) {
  const auto hidden = static_cast<std::int64_t>(static_cast<double>(in_channels) * mlp_ratio);
  mlp_ = register_module("mlp", Mlp(in_channels, hidden, out_channels));
}

namespace {

AttentionOptions attention_options(std::int64_t channels, std::int64_t num_heads, std::int64_t context_channels = 0) {
  AttentionOptions options;
  options.channels = channels;
  options.num_heads = num_heads;
  options.context_channels = context_channels;
  return options;
}

Ragged rows_of_batch(const Tensor& x) {
  TORCH_CHECK(x.dim() == 3, "a modulated block: input ", x.sizes());
  return Ragged(std::vector<std::int64_t>(static_cast<std::size_t>(x.size(0)), x.size(1)));
}

std::int64_t out_width(const DenseBlockOptions& options) {
  return options.out_channels > 0 ? options.out_channels : options.channels;
}

}  // namespace

AttentionOptions self_attention_of(const BlockOptions& options) {
  AttentionOptions attention = attention_options(options.channels, options.num_heads);
  attention.qkv_bias = options.qkv_bias;
  attention.qk_rms_norm = options.qk_rms_norm;
  attention.lora_qkv = attention.lora_out = options.lora_self;
  return attention;
}

AttentionOptions cross_attention_of(const BlockOptions& options, std::int64_t context_channels) {
  TORCH_CHECK(context_channels > 0, "a block with cross attention needs the width of its context");
  AttentionOptions attention = self_attention_of(options);
  attention.context_channels = context_channels;
  attention.qk_rms_norm = options.qk_rms_norm_cross;
  attention.lora_qkv = attention.lora_out = options.lora_cross;
  return attention;
}

TransformerBlockImpl::TransformerBlockImpl(std::int64_t channels, std::int64_t num_heads, double mlp_ratio,
                                           const std::string& attention_name) {
  attention_ = register_module(attention_name, RaggedAttention(attention_options(channels, num_heads)));
  mlp_ = register_module("mlp", FeedForward(channels, channels, mlp_ratio));
}

Tensor TransformerBlockImpl::forward(const Tensor& x, const Ragged& items) {
  const Tensor mixed = x + attention_->forward(layer_norm(x), items);
  return mixed + mlp_->forward(layer_norm(mixed));
}

CrossBlockImpl::CrossBlockImpl(std::int64_t channels, std::int64_t num_heads, double mlp_ratio) {
  attention_ = register_module("cross_attn", RaggedAttention(attention_options(channels, num_heads, channels)));
  mlp_ = register_module("mlp", FeedForward(channels, channels, mlp_ratio));
}

Tensor CrossBlockImpl::forward(const Tensor& x, const Ragged& items, const Tensor& context,
                               const Ragged& context_items) {
  const Tensor mixed = x + attention_->forward(layer_norm(x), items, context, context_items);
  return mixed + mlp_->forward(layer_norm(mixed));
}

Tensor RowModulation::modulate(const Tensor& x) const {
  return modulated_norm(x.flatten(0, -2), items, shift, scale, kBlockNormEps).view(x.sizes());
}

Tensor RowModulation::add_gated(const Tensor& x, const Tensor& result) const {
  return nn::add_gated(x.flatten(0, -2), items, gate, result.flatten(0, -2)).view(x.sizes());
}

std::pair<RowModulation, RowModulation> row_modulations(Modulation& layer, const Tensor& mod, const Ragged& items,
                                                        const Tensor& x) {
  const Tensor rows = layer.is_empty() ? mod : layer->forward(mod);
  TORCH_CHECK(rows.dim() == 2 && rows.size(0) == items.items() && rows.size(1) == 6 * x.size(-1), "modulation ",
              rows.sizes(), " of a block with ", x.size(-1), " channels and ", items.items(), " items");
  const std::vector<Tensor> parts = rows.chunk(6, -1);
  return {{items, parts[0], parts[1], parts[2]}, {items, parts[3], parts[4], parts[5]}};
}

ModulationImpl::ModulationImpl(std::int64_t channels, std::int64_t values) {
  linear = register_module("1", Linear(channels, values));
}

Tensor ModulationImpl::forward(const Tensor& mod) { return linear->forward(torch::silu(mod)); }

ModulatedCrossBlockImpl::ModulatedCrossBlockImpl(const ModulatedBlockOptions& options)
    : ModulatedLayers(options, DenseAttention(self_attention_of(options)),
                      DenseAttention(cross_attention_of(options, options.context_channels))) {}

Tensor ModulatedCrossBlockImpl::forward(const Tensor& x, const Tensor& mod, const Tensor& context,
                                        const GridWindows& windows) {
  const auto attend_self = [&](const Tensor& rows) {
    return windows.divide() ? self_attention_->forward_in_windows(rows, windows) : self_attention_->forward(rows);
  };
  return run(x, rows_of_batch(x), mod, attend_self,
             [&](const Tensor& rows) { return cross_attention_->forward(rows, normed_context(context)); });
}

ModulatedBlockImpl::ModulatedBlockImpl(const ModulatedBlockOptions& options)
    : ModulatedLayers(options, DenseAttention(self_attention_of(options)), nullptr) {}

Tensor ModulatedBlockImpl::forward(const Tensor& x, const Tensor& mod) {
  return run(
      x, rows_of_batch(x), mod, [&](const Tensor& rows) { return self_attention_->forward(rows); }, nullptr);
}

BlockNorm::BlockNorm(torch::nn::Module& block, const char* name, std::int64_t channels, bool affine) {
  if (affine) affine_ = block.register_module(name, AffineLayerNorm(channels, kBlockNormEps));
}

Tensor BlockNorm::operator()(const Tensor& x) { return affine_.is_empty() ? layer_norm(x) : affine_->forward(x); }

BlockOutput::BlockOutput(torch::nn::Module& block, const std::string& mlp, const DenseBlockOptions& options) {
  const std::int64_t channels = options.channels, out = out_width(options);
  mlp_ = block.register_module(mlp, FeedForward(channels, out, options.mlp_ratio));
  if (out != channels) residual_ = block.register_module("res_" + mlp, FeedForward(channels, out, 1.0));
}

Tensor BlockOutput::operator()(const Tensor& x, const Tensor& normed) {
  return (residual_.is_empty() ? x : residual_->forward(x)) + mlp_->forward(normed);
}

DenseBlockImpl::DenseBlockImpl(const DenseBlockOptions& options) {
  norm1_ = BlockNorm(*this, "norm1", options.channels, options.affine_norms);
  norm2_ = BlockNorm(*this, "norm2", options.channels, options.affine_norms);
  attention_ = register_module("attn", DenseAttention(self_attention_of(options)));
  output_ = BlockOutput(*this, "mlp", options);
}

Tensor DenseBlockImpl::forward(const Tensor& x) {
  const Tensor mixed = x + attention_->forward(norm1_(x));
  return output_(mixed, norm2_(mixed));
}

DenseCrossBlockImpl::DenseCrossBlockImpl(const DenseBlockOptions& options) {
  if (options.self_attention) norm1_ = BlockNorm(*this, "norm1", options.channels, options.affine_norms);
  norm2_ = BlockNorm(*this, "norm2", options.channels, options.affine_norms);
  norm3_ = BlockNorm(*this, "norm3", options.channels, options.affine_norms);
  if (options.self_attention)
    self_attention_ = register_module("self_attn", DenseAttention(self_attention_of(options)));
  cross_attention_ =
      register_module("cross_attn", DenseAttention(cross_attention_of(options, options.context_channels)));
  output_ = BlockOutput(*this, "mlp", options);
}

Tensor DenseCrossBlockImpl::forward(const Tensor& x, const Tensor& context) {
  Tensor mixed = self_attention_.is_empty() ? x : x + self_attention_->forward(norm1_(x));
  mixed = mixed + cross_attention_->forward(norm2_(mixed), context);
  return output_(mixed, norm3_(mixed));
}

SkinCrossBlockImpl::SkinCrossBlockImpl(const DenseBlockOptions& options) {
  norm1_ = BlockNorm(*this, "norm1", options.channels, options.affine_norms);
  norm2_ = BlockNorm(*this, "norm2", options.channels, options.affine_norms);
  norm3_ = BlockNorm(*this, "norm3", options.channels, options.affine_norms);
  attention_ = register_module("joint_attn", DenseAttention(self_attention_of(options)));
  to_values_ = register_module("to_v", Linear(options.channels, options.channels));
  output_ = BlockOutput(*this, "mlp", options);
  joint_output_ = BlockOutput(*this, "joint_mlp", options);
}

SkinCrossBlockImpl::Output SkinCrossBlockImpl::forward(const Tensor& vertices, const Tensor& joints,
                                                       const Tensor& skin) {
  const Tensor mixed = vertices + torch::matmul(skin, to_values_->forward(norm1_(joints)));
  const Tensor attended = joints + attention_->forward(norm3_(joints));
  return {output_(mixed, norm2_(mixed)), joint_output_(joints, attended)};
}

}  // namespace anigen::nn
