#include "anigen/nn/attention.h"

#include <cmath>
#include <vector>

#include "anigen/nn/ragged_attention.h"

namespace anigen::nn {
namespace {

void check(const AttentionOptions& options) {
  TORCH_CHECK(options.num_heads > 0 && options.channels % options.num_heads == 0, "attention with ", options.channels,
              " channels cannot have ", options.num_heads, " heads");
}

// [ΣN, parts·h·d] → views [ΣN, h, d] of the parts.
std::vector<Tensor> split_heads(const Tensor& x, std::int64_t parts, std::int64_t heads) {
  return x.view({x.size(0), parts, heads, x.size(1) / (parts * heads)}).unbind(1);
}

}  // namespace

Tensor attend(const Tensor& q, const Tensor& k, const Tensor& v, const Tensor& mask) {
  const torch::Dtype dtype = dtype_of(q);
  const double scale = 1.0 / std::sqrt(static_cast<double>(q.size(-1)));
  Tensor scores = torch::matmul(q * scale, k.transpose(-2, -1));
  if (mask.defined()) scores = scores + mask;
  const Tensor weights = torch::softmax(scores, -1, accumulation_dtype(dtype)).to(dtype);
  return torch::matmul(weights, v);
}

SelfAttentionImpl::SelfAttentionImpl(const AttentionOptions& options) : num_heads_(options.num_heads) {
  check(options);
  to_qkv_ = register_module("to_qkv", Linear(options.channels, 3 * options.channels, options.qkv_bias));
  to_out_ = register_module("to_out", Linear(options.channels, options.channels));
}

Tensor SelfAttentionImpl::forward(const Tensor& x, const Ragged& items) {
  const std::vector<Tensor> qkv = split_heads(to_qkv_->forward(x), 3, num_heads_);
  const Tensor offsets = items.row_offsets();
  return to_out_->forward(ragged_attention(qkv[0], qkv[1], qkv[2], offsets, offsets).flatten(1));
}

CrossAttentionImpl::CrossAttentionImpl(const AttentionOptions& options) : num_heads_(options.num_heads) {
  check(options);
  const std::int64_t context = options.context_channels > 0 ? options.context_channels : options.channels;
  to_q_ = register_module("to_q", Linear(options.channels, options.channels, options.qkv_bias));
  to_kv_ = register_module("to_kv", Linear(context, 2 * options.channels, options.qkv_bias));
  to_out_ = register_module("to_out", Linear(options.channels, options.channels));
}

Tensor CrossAttentionImpl::forward(const Tensor& x, const Ragged& items, const Tensor& context,
                                   const Ragged& context_items) {
  TORCH_CHECK(items.items() == context_items.items(), "cross attention of ", items.items(), " items to ",
              context_items.items(), " contexts");
  const Tensor q = split_heads(to_q_->forward(x), 1, num_heads_)[0];
  const std::vector<Tensor> kv = split_heads(to_kv_->forward(context), 2, num_heads_);
  const Tensor mixed = ragged_attention(q, kv[0], kv[1], items.row_offsets(), context_items.row_offsets());
  return to_out_->forward(mixed.flatten(1));
}

}  // namespace anigen::nn
