#include "anigen/nn/dense_attention.h"

#include <vector>

#include "anigen/nn/blocked_attention.h"
#include "anigen/nn/kept_contexts.h"

namespace anigen::nn {
namespace {

// [B, N, parts·C] → views [B, N, H, D] of the parts.
std::vector<Tensor> dense_heads(const Tensor& x, std::int64_t parts, std::int64_t heads) {
  return x.view({x.size(0), x.size(1), parts, heads, x.size(2) / (parts * heads)}).unbind(2);
}

}  // namespace

DenseAttentionImpl::DenseAttentionImpl(const DenseAttentionOptions& options)
    : num_heads_(options.num_heads), channels_(options.channels) {
  TORCH_CHECK(options.num_heads > 0 && options.channels % options.num_heads == 0, "attention with ", options.channels,
              " channels cannot have ", options.num_heads, " heads");
  TORCH_CHECK(options.context_channels > 0 || !options.x_is_query, "x_is_query is an option of cross attention");
  const std::int64_t channels = options.channels, context = options.context_channels;
  if (context == 0) {
    to_qkv_ = register_module("to_qkv", Linear(channels, 3 * channels, options.qkv_bias, options.lora_qkv));
  } else {
    if (!options.x_is_query) {
      to_q_ = register_module("to_q", Linear(channels, channels, options.qkv_bias, options.lora_qkv));
    }
    to_kv_ = register_module("to_kv", Linear(context, 2 * channels, options.qkv_bias, options.lora_qkv));
  }
  if (options.qk_rms_norm) {
    q_rms_norm_ = register_module("q_rms_norm", MultiHeadRmsNorm(channels / num_heads_, num_heads_));
    k_rms_norm_ = register_module("k_rms_norm", MultiHeadRmsNorm(channels / num_heads_, num_heads_));
  }
  to_out_ = register_module("to_out", Linear(channels, channels, /*with_bias=*/true, options.lora_out));
}

std::vector<Tensor> DenseAttentionImpl::keys_and_values(const Tensor& context) {
  return projected_context(this, context, [&] {
    std::vector<Tensor> kv = dense_heads(to_kv_->forward(context), 2, num_heads_);
    if (!k_rms_norm_.is_empty()) kv[0] = k_rms_norm_->forward(kv[0]);
    return kv;
  });
}

Tensor DenseAttentionImpl::forward(const Tensor& x, const Tensor& context) {
  TORCH_CHECK(x.dim() == 3 && x.size(2) == channels_, "dense attention over ", channels_, " channels: input ",
              x.sizes());
  TORCH_CHECK(context.defined() == to_qkv_.is_empty(), "dense attention: ",
              context.defined() ? "self attention was given a context" : "cross attention needs a context");
  std::vector<Tensor> qkv;
  if (context.defined()) {
    TORCH_CHECK(context.dim() == 3 && context.size(0) == x.size(0), "cross attention: input ", x.sizes(), ", context ",
                context.sizes());
    qkv = dense_heads(to_q_.is_empty() ? x.contiguous() : to_q_->forward(x), 1, num_heads_);
    for (const Tensor& part : keys_and_values(context)) qkv.push_back(part);
  } else {
    qkv = dense_heads(to_qkv_->forward(x), 3, num_heads_);
  }
  if (!q_rms_norm_.is_empty()) {
    qkv[0] = q_rms_norm_->forward(qkv[0]);
    if (!context.defined()) qkv[1] = k_rms_norm_->forward(qkv[1]);
  }
  const Tensor mixed = blocked_attention(qkv[0].transpose(1, 2), qkv[1].transpose(1, 2), qkv[2].transpose(1, 2));
  return to_out_->forward(mixed.transpose(1, 2).reshape(x.sizes()));
}

}  // namespace anigen::nn
