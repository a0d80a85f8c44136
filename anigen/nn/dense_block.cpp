#include "anigen/nn/dense_block.h"

#include "anigen/nn/layer_norm.h"

namespace anigen::nn {
namespace {

std::int64_t out_width(const DenseBlockOptions& options) {
  return options.out_channels > 0 ? options.out_channels : options.channels;
}

DenseAttentionOptions block_self(const DenseBlockOptions& options) {
  DenseAttentionOptions attention;
  attention.channels = options.channels;
  attention.num_heads = options.num_heads;
  attention.qkv_bias = options.qkv_bias;
  attention.qk_rms_norm = options.qk_rms_norm;
  return attention;
}

DenseAttentionOptions block_cross(const DenseBlockOptions& options) {
  TORCH_CHECK(options.context_channels > 0, "a block with cross attention needs the width of its context");
  DenseAttentionOptions attention = block_self(options);
  attention.context_channels = options.context_channels;
  attention.qk_rms_norm = options.qk_rms_norm_cross;
  return attention;
}

}  // namespace

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
  attention_ = register_module("attn", DenseAttention(block_self(options)));
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
  if (options.self_attention) self_attention_ = register_module("self_attn", DenseAttention(block_self(options)));
  cross_attention_ = register_module("cross_attn", DenseAttention(block_cross(options)));
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
  attention_ = register_module("joint_attn", DenseAttention(block_self(options)));
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
